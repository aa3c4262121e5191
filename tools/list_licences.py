"""List the licences of all dependencies that are installed, as a table in Markdown.

python tools/list_licences.py                # of the package and its extras for users
python tools/list_licences.py --extra learn  # of the package and one extra
"""

import argparse
import importlib.metadata
import re
import sys

from packaging.requirements import Requirement

PACKAGE = "cablecast"
UNKNOWN = "not stated"
_LINE_MAX = 80


def dependencies(extras: tuple[str, ...]) -> dict[str, importlib.metadata.Distribution | None]:
    """Return the installed distributions that the package needs, and theirs; None where missing.

    Args:
        extras: Extras of the package.
    """
    found: dict[str, importlib.metadata.Distribution | None] = {}
    # Names with the extras that are asked of them.
    queue: list[tuple[str, tuple[str, ...]]] = [(PACKAGE, extras)]
    seen = set()
    while queue:
        name, asked = queue.pop()
        key = (normal(name), asked)
        if key in seen:
            continue
        seen.add(key)
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            found[normal(name)] = None
            continue
        found[normal(name)] = distribution
        for line in distribution.requires or ():
            requirement = Requirement(line)
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": e}) for e in ("", *asked)):
                queue.append((requirement.name, tuple(sorted(requirement.extras))))
    found.pop(PACKAGE, None)
    return dict(sorted(found.items()))


def normal(name: str) -> str:
    """Return the name of a distribution as indexes write it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(distribution: importlib.metadata.Distribution) -> str:
    """Return the licence that a distribution states, the shortest form first."""
    metadata = distribution.metadata
    if expression := metadata.get("License-Expression"):
        return expression
    prefix = "License :: "
    classifiers = [
        line.rpartition(" :: ")[2]
        for line in metadata.get_all("Classifier") or ()
        if line.startswith(prefix) and line != "License :: OSI Approved"
    ]
    if classifiers:
        return ", ".join(classifiers)
    # The field may hold a whole licence; its first line names it.
    lines = (metadata.get("License") or "").strip().splitlines()
    return lines[0].strip()[:_LINE_MAX] if lines else UNKNOWN


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--extra", action="append", help="extra of the package; all where missing")
    args = parser.parse_args()
    rows = dependencies(tuple(args.extra or ("all",)))
    print("| package | version | licence |\n|---|---|---|")
    for name, distribution in rows.items():
        if distribution is None:
            print(f"| {name} | not installed | |")
        else:
            print(f"| {name} | {distribution.version} | {licence(distribution)} |")
    unknown = [name for name, row in rows.items() if row is not None and licence(row) == UNKNOWN]
    if unknown:
        print(f"no licence is stated by {', '.join(unknown)}", file=sys.stderr)


if __name__ == "__main__":
    main()
