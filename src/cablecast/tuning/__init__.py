"""Fitting the simulator to measured casts: parameters of the cable, and the arm's servo."""

from cablecast.tuning.result import read_params, read_servo

__all__ = ["read_params", "read_servo"]
