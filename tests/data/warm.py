"""What a process that writes these datasets computes at first."""

from tests.data import stick_engine, stick_rig

from cablecast.motion.feasibility import feasible_ranges

for setup in (stick_engine.SETUP, stick_rig.SETUP):
    feasible_ranges(setup)
