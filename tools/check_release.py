"""Build the source distribution and the wheel, check them, and try them in fresh environments.

    python tools/check_release.py                        # build and check, seconds
    python tools/check_release.py --install              # and install the wheel alone and run it
    python tools/check_release.py --install learn gym    # and with each of these extras alone

Both are left in build/dist. Installing needs the package index; the versions are those of
constraints.txt.

    python tools/check_release.py --licences             # table of what it depends on
    python tools/check_release.py --licences learn       # with one extra alone
"""

import argparse
import importlib.metadata
import pathlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
import zipfile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = pathlib.Path(__file__).parents[1]
DIST = ROOT / "build" / "dist"
PACKAGE = "cablecast"
UNKNOWN = "not stated"
_LINE_MAX = 80

# What each extra is for, in a few lines that fail without it. "" is the package alone.
TRIALS = {
    "": """
import pathlib, cablecast as cc
assert cc.simulate(cc.Setup(), count=16).ok.any()
""",
    "learn": """
import cablecast as cc
policy = cc.train(cc.simulate(cc.Setup(), count=64), epochs=1, candidate_count=64)
assert policy.plan(r=1.0, theta_deg=5).predicted_xy.shape == (1, 2)
""",
    "mujoco": """
import cablecast as cc
with cc.make_rig("virtual", cc.Setup()) as rig:
    assert len(cc.collect(rig, count=1)) == 1
""",
    "pybullet": """
from cablecast.engines.pybullet_ import EnginePybullet
EnginePybullet()
""",
    "camera": """
from cablecast.vision.tags import load_cv2
load_cv2()
""",
    "report": "import cablecast.report.page, cablecast.report.style, matplotlib, jinja2, shapely",
    "gym": """
import gymnasium
env = gymnasium.make("cablecast.gym:cablecast/Cast-v0")
env.reset(seed=0)
assert env.step(env.action_space.sample())[2]
""",
    "ray": "import ray",
    "view": "import cablecast.view, av, trimesh, viser",
}


def run(*words: object) -> None:
    """Run a command, and stop with its status where it fails."""
    done = subprocess.run([str(word) for word in words], cwd=ROOT, check=False)
    if done.returncode:
        sys.exit(done.returncode)


def build() -> tuple[pathlib.Path, pathlib.Path]:
    """Build both distributions anew, and return the source distribution and the wheel."""
    for folder in (DIST, ROOT / "build" / "lib"):
        shutil.rmtree(folder, ignore_errors=True)
    # Without isolation nothing is fetched.
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", DIST, ROOT)
    (source,), (wheel,) = DIST.glob("*.tar.gz"), DIST.glob("*.whl")
    run(sys.executable, "-m", "twine", "check", "--strict", source, wheel)
    return source, wheel


def check_content(source: pathlib.Path, wheel: pathlib.Path) -> None:
    """Refuse distributions that lack a file of the package, its licence or its README."""
    package = ROOT / "src"
    # Whatever git tracks there belongs to the package.
    tracked = subprocess.run(
        ["git", "ls-files", "src"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    wanted = {(ROOT / name).relative_to(package).as_posix() for name in tracked}
    there = set(zipfile.ZipFile(wheel).namelist())
    if missing := sorted(wanted - there):
        sys.exit(f"{wheel.name} lacks {', '.join(missing)}")
    if not any(name.endswith("licenses/LICENSE") for name in there):
        sys.exit(f"{wheel.name} lacks the licence")
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    needed = {f"src/{name}" for name in wanted} | {"pyproject.toml", "README.md", "LICENSE"}
    if missing := sorted(needed - names):
        sys.exit(f"{source.name} lacks {', '.join(missing)}")
    print(f"{source.name} and {wheel.name} hold the package's {len(wanted)} files")


def try_extra(wheel: pathlib.Path, extra: str) -> None:
    """Install the wheel with one extra into a fresh environment, and use it."""
    with tempfile.TemporaryDirectory(prefix="cablecast-") as folder:
        venv.create(folder, with_pip=True)
        python = pathlib.Path(folder) / "bin" / "python"
        what = f"{wheel}[{extra}]" if extra else str(wheel)
        run(python, "-m", "pip", "install", "-q", "-c", ROOT / "constraints.txt", what)
        run(python, "-m", "pip", "check")
        run(pathlib.Path(folder) / "bin" / "cablecast", "--version")
        # Outside the checkout, so that the installed package is the one that runs.
        done = subprocess.run([python, "-I", "-c", TRIALS[extra]], cwd=folder, check=False)
        if done.returncode:
            sys.exit(f"the extra {extra or '(none)'} does not work alone")
    print(f"extra {extra or '(none)'}: installed alone, and works")


def extras() -> list[str]:
    """Return the extras of users, without those of developers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return [name for name in project["optional-dependencies"] if name not in ("dev", "docs", "all")]


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
        name = canonicalize_name(name)
        if (name, asked) in seen:
            continue
        seen.add((name, asked))
        try:
            found[name] = distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
            continue
        for line in distribution.requires or ():
            requirement = Requirement(line)
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": e}) for e in ("", *asked)):
                queue.append((requirement.name, tuple(sorted(requirement.extras))))
    found.pop(PACKAGE, None)
    return dict(sorted(found.items()))


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


def print_licences(extras: tuple[str, ...]) -> None:
    """Print the installed dependencies of the package with these extras, and their licences."""
    rows = dependencies(extras)
    print("| package | version | licence |\n|---|---|---|")
    for name, distribution in rows.items():
        if distribution is None:
            print(f"| {name} | not installed | |")
        else:
            print(f"| {name} | {distribution.version} | {licence(distribution)} |")
    unknown = [name for name, row in rows.items() if row is not None and licence(row) == UNKNOWN]
    if unknown:
        print(f"no licence is stated by {', '.join(unknown)}", file=sys.stderr)


def main() -> None:
    """Build, check and try the distributions, or list the licences of the dependencies."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "--install",
        nargs="*",
        metavar="EXTRA",
        help="try the wheel alone, and with each of these extras alone; `every` for all of them",
    )
    parser.add_argument(
        "--licences",
        nargs="*",
        metavar="EXTRA",
        help="list licences and stop; of all extras for users, or of these",
    )
    args = parser.parse_args()
    if args.licences is not None:
        print_licences(tuple(args.licences or ("all",)))
        return
    source, wheel = build()
    check_content(source, wheel)
    if args.install is not None:
        chosen = extras() if args.install == ["every"] else args.install
        for extra in ["", *chosen]:
            if extra not in TRIALS:
                sys.exit(f"there is no extra {extra}: one of {', '.join(extras())}")
            try_extra(wheel, extra)


if __name__ == "__main__":
    main()
