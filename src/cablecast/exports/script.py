"""script: a Python file that stands alone, of a comment, numbers, and the code of a module here."""

import importlib.resources
import pprint
from collections.abc import Mapping, Sequence
from typing import Any

_EMPTY = "VALUES: dict[str, Any] = {}\n"


def script(module: str, lines: Sequence[str], values: Mapping[str, Any]) -> str:
    """Return the text of a script.

    Args:
        module: Name of the module of this package whose code it has.
        lines: Its docstring, line by line.
        values: Numbers that the code finds as `VALUES`.
    """
    file = importlib.resources.files("cablecast.exports").joinpath(f"{module}.py")
    code = file.read_text(encoding="utf-8")
    # Its own docstring gives way to that of the script.
    code = code.split('"""', 2)[2].lstrip()
    numbers = pprint.pformat(_rounded(dict(values)), width=98, compact=True, sort_dicts=False)
    text = "\n".join(lines).replace("\\", "/")
    return f'"""{text}\n"""\n\n' + code.replace(_EMPTY, f"VALUES: dict[str, Any] = {numbers}\n")


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.9g}") if isinstance(value, float) else value
