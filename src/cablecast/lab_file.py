"""Changes to a lab file that leave alone what else a person wrote into it."""

import pathlib
import re
from collections.abc import Mapping
from typing import Any

import yaml

from cablecast.errors import InputError
from cablecast.files import write_text
from cablecast.reading import parse_yaml, read_text
from cablecast.setup import Setup


def update_lab_file(path: pathlib.Path, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """Set keys of a lab file, and keep its other lines and its comments.

    Args:
        path: Lab file.
        changes: New values by section and key.

    Raises:
        InputError: There is no such file, or the changed file would be no set-up.
    """
    try:
        text = read_text(path)
    except FileNotFoundError as error:
        raise InputError(str(error)) from None
    values = parse_yaml(text, str(path))
    for name, section in changes.items():
        old = values.get(name) or {}
        if not isinstance(old, Mapping):
            raise InputError(f"section `{name}` of {path} must be a mapping to be changed")
        values[name] = {**old, **section}
        changed = _with_section(text, name, section)
        if _parse(changed) != values:
            # Written in a way that cannot be changed line by line, such as {a: 1, b: 2}.
            changed = _without_section(text, name) + _block(name, values[name])
        text = changed
    if _parse(text) != values:
        raise InputError(f"{path} cannot be changed: write each section on lines of its own")
    Setup.from_dict(values, path.parent)
    write_text(path, text)


def _with_section(text: str, name: str, section: Mapping[str, Any]) -> str:
    """Return a text with some keys of a section set."""
    lines = text.splitlines()
    begin, end = _section(lines, name)
    if begin is None:
        return text.rstrip("\n") + "\n" + _block(name, section)
    written = [line for line in lines[begin + 1 : end] if line.strip()[:1] not in ("", "#")]
    indent = _indent(written[0]) if written else 2
    for key, value in section.items():
        _, end = _section(lines, name)
        new = [" " * indent + line for line in _dump({key: value}).splitlines()]
        for place in range(begin + 1, end):
            if re.match(rf" {{{indent}}}{re.escape(key)}\s*:", lines[place]):
                stop = place + 1
                while stop < end and _belongs(lines[stop], indent):
                    stop += 1
                if len(new) == 1 and stop == place + 1 and (tail := _comment(lines[place])):
                    new[0] += tail
                lines[place:stop] = new
                break
        else:
            lines[end:end] = new
    return "\n".join(lines) + "\n"


def _without_section(text: str, name: str) -> str:
    """Return a text without a section."""
    lines = text.splitlines()
    begin, end = _section(lines, name)
    if begin is not None:
        del lines[begin:end]
    return "\n".join(lines).rstrip("\n") + "\n"


def _section(lines: list[str], name: str) -> tuple[int | None, int]:
    """Return the first line of a section, and the line after its last; None where there is none."""
    for begin, line in enumerate(lines):
        if re.match(rf"{re.escape(name)}\s*:", line):
            end = begin + 1
            last = end
            while end < len(lines) and (not lines[end].strip() or lines[end][0] in " #-"):
                # Comments and empty lines before the next section are its own.
                if lines[end].strip() and lines[end][0] in " -":
                    last = end + 1
                end += 1
            return begin, last
    return None, len(lines)


def _belongs(line: str, indent: int) -> bool:
    """Return whether a line goes on with the value of a key at some indentation."""
    if not line.strip():
        return False
    return _indent(line) > indent or (_indent(line) == indent and line.lstrip().startswith("- "))


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _comment(line: str) -> str:
    """Return the comment at the end of a line with a plain value, and the blanks before it."""
    match = re.match(r"\s*\w+\s*:\s*[^'\"#\s]+(\s+#.*)$", line)
    return match.group(1) if match else ""


def _block(name: str, section: Mapping[str, Any]) -> str:
    """Return a section, each key on a line of its own."""
    lines = [line for key, value in section.items() for line in _dump({key: value}).splitlines()]
    return "\n".join([f"{name}:", *(f"  {line}" for line in lines)]) + "\n"


def _dump(values: Mapping[str, Any]) -> str:
    text = yaml.safe_dump(
        dict(values), sort_keys=False, allow_unicode=True, default_flow_style=None, width=96
    )
    # A mapping of one plain value comes in braces.
    if text.startswith("{"):
        text = yaml.safe_dump(dict(values), allow_unicode=True, default_flow_style=False)
    return text


def _parse(text: str) -> Any:
    try:
        return parse_yaml(text, "lab file")
    except InputError:
        return None
