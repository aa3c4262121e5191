"""How well a policy does: casts on a rig, target errors, coverage, and the paper's figures."""
