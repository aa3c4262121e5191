"""Tuning: fits the simulator to measured casts, the cable's parameters and the arm's servo."""

from cablecast.tuning.result import read_dynamics, read_params

__all__ = ["read_dynamics", "read_params"]
