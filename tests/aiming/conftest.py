import pathlib
import sys

# Tests are imported without their folder on the path.
sys.path.insert(0, str(pathlib.Path(__file__).parent))
