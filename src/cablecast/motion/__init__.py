"""From actions to grip paths, joint paths and their feasibility."""
