"""Tuning: fits the simulator to measured casts, the cable's parameters and the arm's servo."""
