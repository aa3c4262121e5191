"""`python -m cablecast`, the same as the command `cablecast`."""

import sys

from cablecast.cli import main

if __name__ == "__main__":
    sys.exit(main())
