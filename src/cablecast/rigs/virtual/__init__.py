"""A laboratory in software that plays the real world: physics that the learning engine lacks."""

from cablecast.rigs.virtual.config import TrialNoise, VirtualConfig
from cablecast.rigs.virtual.rig import RigVirtual

__all__ = ["RigVirtual", "TrialNoise", "VirtualConfig"]
