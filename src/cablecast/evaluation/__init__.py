"""Evaluation: casts on a rig, target errors, coverage, repeatability, and the paper's figures."""
