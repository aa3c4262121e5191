"""Checks of a verb's input before its rig is connected: a cast takes 20 s, a typing error none."""

import os
from collections.abc import Sequence

from cablecast.setup import Setup
from cablecast.workspace import load_targets

Folder = str | os.PathLike[str] | None


def check_way(setups: Sequence[Setup], device: str) -> None:
    """Check what later steps on the way from the first cast to the evaluation need.

    Args:
        setups: Set-up of each cable.
        device: "cpu" or "cuda".

    Raises:
        InputError: The device is not here.
        TargetError: A target of the evaluation is out of reach of arm and cable, or off the table.
    """
    from cablecast.engines import make_engine

    make_engine("warp", device=device)
    if device != "cpu":
        from cablecast.learning.checkpoint import check_device

        check_device(device)
    for setup in setups:
        setup.workspace.check_targets(load_targets(), cable_length=setup.cable.length)
