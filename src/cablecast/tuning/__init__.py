"""Tuning: fits the simulator to measured casts, the cable's parameters and the arm's servo."""

from cablecast.tuning.result import read_params, read_servo

__all__ = ["read_params", "read_servo"]
