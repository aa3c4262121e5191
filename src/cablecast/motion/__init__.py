"""Motions: actions, grip paths, joint paths, and their feasibility for the arm."""
