"""cablecast: teach a robot arm to throw the free end of a cable onto a target."""

__version__ = "0.1.0"
