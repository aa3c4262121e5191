"""The command line: one file per verb, heavy libraries imported only where needed."""

from cablecast.cli.main import main

__all__ = ["main"]
