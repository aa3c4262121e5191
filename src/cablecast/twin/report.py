"""State of the twin's controller as RTDE reports it."""

from typing import Any

import numpy as np

from cablecast.twin.controller import (
    MODE_RUNNING,
    RUNTIME_PLAYING,
    RUNTIME_STOPPED,
    SAFETY_EMERGENCY,
    SAFETY_NORMAL,
    SAFETY_PROTECTIVE,
    Controller,
)
from cablecast.twin.rtde_protocol import OUTPUTS, TYPES

ENCODER_ERROR = 5e-5
"""Standard deviation of a reported angle, as in the virtual laboratory [rad]."""
_RATE_ERROR = 20 * ENCODER_ERROR
_CONSTANTS: dict[str, Any] = {
    "joint_mode": [255] * 6,
    "joint_temperatures": [30.0] * 6,
    "actual_main_voltage": 48.0,
    "actual_robot_voltage": 48.0,
    "actual_joint_voltage": [48.0] * 6,
}
_ZEROS = {
    name: [0.0] * int(TYPES[kind][:-1] or 1) if kind.startswith("VECTOR") else 0
    for name, kind in OUTPUTS.items()
}


class Reporter:
    """Collects what a controller reports, with the noise of its encoders.

    Args:
        controller: Controller that is reported on.
        seed: Seed of the noise.
    """

    def __init__(self, controller: Controller, seed: int = 0):
        self.controller = controller
        self._rng = np.random.default_rng([seed, 79])

    def state(self) -> dict[str, Any]:
        """Return the value of every variable."""
        c = self.controller
        noise = self._rng.normal(size=(2, 6))
        powered = c.robot_mode == MODE_RUNNING
        state = {
            **_ZEROS,
            **_CONSTANTS,
            "timestamp": c.time,
            "target_q": c.target_q.tolist(),
            "target_qd": c.target_qd.tolist(),
            "actual_q": (c.arm.q + ENCODER_ERROR * noise[0]).tolist(),
            "actual_qd": (c.arm.qd + _RATE_ERROR * noise[1] * (not c.at_rest)).tolist(),
            "robot_mode": c.robot_mode,
            "safety_mode": c.safety_mode,
            "safety_status": c.safety_mode,
            "speed_scaling": 1.0 if powered else 0.0,
            "target_speed_fraction": c.speed_slider,
            "runtime_state": RUNTIME_PLAYING if c.is_running_program else RUNTIME_STOPPED,
            "robot_status_bits": int(powered) | int(c.is_running_program) << 1,
            "safety_status_bits": _safety_bits(c.safety_mode),
            "payload": c.payload,
            "payload_cog": c.payload_cog,
        }
        for index in range(48):
            state[f"output_int_register_{index}"] = c.int_registers[index]
            state[f"output_double_register_{index}"] = c.double_registers[index]
        return state


def _safety_bits(mode: int) -> int:
    """Return the bits of RTDE's safety_status_bits."""
    if mode == SAFETY_PROTECTIVE:
        return 1 << 2 | 1 << 10
    if mode == SAFETY_EMERGENCY:
        return 1 << 6 | 1 << 7 | 1 << 10
    return 1 if mode == SAFETY_NORMAL else 1 << 9
