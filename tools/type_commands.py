"""Type the commands of README and docs, as they stand, in a fresh clone.

    python tools/type_commands.py /tmp/typed
    python tools/type_commands.py /tmp/typed --pages README.md docs/aim.md

Clones the repository into the folder, and types every line of every block of commands in bash, from
the root of the clone, with its .venv active. What a page takes from the reader's laboratory (a lab
file, a rig, films, a log) is made before: MADE. A twin runs next to the rest of its page, `view`
ends when it answers, and pip installs into an environment of its own. What cannot be typed here is
named with what runs it instead: ELSEWHERE.

Each command is a line of typed.md, with exit status and time; what it printed lies in typed/. A
status of 3 says that a target was missed, or that there is something to change. Started again, it
goes on with the commands that did not end well. The exit status is 1 where one did not.
"""

import argparse
import dataclasses
import json
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence

ROOT = pathlib.Path(__file__).resolve().parents[1]

PAGES = (
    "README.md",
    *(
        f"docs/{name}.md"
        for name in (
            "install",
            "tutorial-simulator",
            "tutorial-cable",
            "tutorial-robot",
            "lab",
            "aim",
            "strike",
            "tuning",
            "learning",
            "view",
            "data",
            "cluster",
            "select",
            "reset",
            "your-own-rig",
            "camera",
            "other-simulators",
            "robot",
            "ursim",
            "reproduce",
            "robustness",
        )
    ),
)
"""Pages with commands; each may use what those before it made."""

ELSEWHERE = {
    "make test": "continuous integration",
    "python tools/make_casts.py casts": "an hour; tests/test_make_casts.py, smaller",
    "cablecast reproduce": "days; tests/pipeline/test_reproduce.py, smaller",
    "cablecast reproduce --quick": "an hour; python -m benchmarks reproduce --quick",
    "cablecast reproduce --quick --engine pybullet": (
        "hours; python -m benchmarks reproduce --quick --cables cable_1 --engine pybullet"
    ),
    "python tools/attack.py inputs --count 800": "half an hour; it is such a tool itself",
    "python tools/attack.py kills --count 200": "half an hour; it is such a tool itself",
    "python tools/fit_camera_error.py --clips 150 --write": "rewrites the package; a tool itself",
    "cablecast reproduce --workers ray": "days; tests/runs/test_workers.py",
    "cablecast simulate --params runs/cable_1/tune --workers ray:10.0.0.5:6379": "a cluster",
    "cablecast camera sync --setup lab.yaml --film swing.mkv --log joints.csv --no-write": (
        "another robot; tests/cli/test_camera.py"
    ),
    "cablecast calibrate table --setup lab.yaml": "asks a person; tests/cli/test_calibrate.py",
    "cablecast calibrate lens --setup lab.yaml": "asks a person; tests/cli/test_calibrate.py",
    "cablecast import takes/ --points points.csv --end tip --grip gripper ahead"
    " --cable my_cable.yaml": "motion capture; tests/cli/test_data.py",
}
"""Commands that are not typed here, without their comments, and what runs them."""

NEWCOMER_LAB = """\
cable: {name: my_rope, length: 0.75, diameter: 0.006, mass: 0.028}
workspace: {table_width: 2.2, table_depth: 1.3}
arm: {model: ur5e, base_height: 0.127}
"""
MY_LAB = """\
from cablecast.rigs.virtual import RigVirtual


def make_rig(setup, seed):
    return RigVirtual(setup, seed)
"""
FILM = (
    "python tools/film.py trial film --action -40 35 0.65 60",
    "cp -r film/. . && mv trial.mp4 cast.mp4",
)
TWIN = "cablecast twin --setup lab.yaml"
RECORDED = """\
import pandas as pd
from cablecast.data.dataset import read_dataset

casts, rows = read_dataset("runs/cable_1/tune-data"), []
for index in range(len(casts)):
    track, joints = casts.track(index), casts.measured_joints(index)
    ends = pd.DataFrame(track.endpoint_xy, columns=["x_m", "y_m"]).assign(time_s=track.times)
    arm = pd.DataFrame(joints.q, columns=[f"q{i + 1}_rad" for i in range(6)])
    rows.append(pd.concat([ends, arm.assign(time_s=joints.times)]).assign(cast=index))
pd.concat(rows).to_csv("recorded.csv", index=False)
"""
"""Casts of the virtual rig as a table that somebody recorded."""


def write(path: str, text: str) -> str:
    """Return the command that writes a file."""
    return f"printf %s {shlex.quote(text)} > {path}"


MADE = {
    ("README.md", "cablecast aim --setup lab.yaml --rig my_lab:make_rig"): (
        write("lab.yaml", NEWCOMER_LAB),
        write("my_lab.py", MY_LAB),
    ),
    ("docs/lab.md", "cablecast collect"): ("cp examples/lab.yaml lab.yaml",),
    ("docs/learning.md", "cablecast plan --target"): (
        "sed 's/measured: false/measured: true/' examples/lab.yaml > lab.yaml",
    ),
    ("docs/aim.md", "cablecast aim --target 1.00 5"): (
        write("lab.yaml", NEWCOMER_LAB),
        "rm -rf runs/my_lab/aim",
    ),
    ("docs/data.md", "cablecast import recorded.csv"): (
        "cp examples/lab.yaml lab.yaml",
        "printf 'length: 0.62\\ndiameter: 0.011\\nmass: 0.05\\n' > my_cable.yaml",
        f"python -c {shlex.quote(RECORDED)}",
    ),
    ("docs/cluster.md", "cablecast simulate"): ("rm -rf runs/cable_1/dataset",),
    ("docs/cluster.md", "cablecast tune"): ("rm -rf runs/cable_1/tune",),
    ("docs/cluster.md", "cablecast select"): ("rm -rf runs/cable_1/select",),
    ("docs/select.md", "cablecast select"): ("rm -rf runs/cable_1/select",),
    ("docs/your-own-rig.md", "cablecast aim"): (
        "rm -rf runs/my_lab",
        "cp examples/lab.yaml lab.yaml",
        "cp examples/05_your_own_rig.py my_lab.py",
    ),
    ("docs/camera.md", "cablecast track cast.mp4"): FILM,
    ("docs/camera.md", "cablecast camera check"): ("cp examples/twin.yaml lab.yaml", TWIN),
    ("docs/tutorial-simulator.md", "cablecast check"): (write("my_lab.yaml", NEWCOMER_LAB),),
    ("docs/tutorial-robot.md", "cablecast check"): (
        "rm -rf runs/my_lab",
        "sed 's/seen_safe: true/seen_safe: false/' examples/twin.yaml > lab.yaml",
        TWIN,
    ),
    ("docs/tutorial-robot.md", "cablecast aim --rig ur --setup lab.yaml"): (
        "sed -i 's/seen_safe: false/seen_safe: true/' lab.yaml",
    ),
}
"""What is made before the first command of a page that begins so."""

SERVERS = ("cablecast view", "cablecast twin")
GOOD = (0, 3)
SERVER_TIME = 120.0
"""Time in which a server must say where it is, and end [s]."""


@dataclasses.dataclass(frozen=True)
class Command:
    """A line of a block.

    Attributes:
        page: Its page, from the root.
        block: Number of its block on the page.
        line: What is typed, continued lines joined, the comment with it.
    """

    page: str
    block: int
    line: str

    @property
    def plain(self) -> str:
        """The words without the comment."""
        return " ".join(shlex.split(self.line, comments=True))


def blocks(text: str) -> list[tuple[str, str]]:
    """Return language and content of each fenced block of a page."""
    return re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def commands_of(page: str) -> list[Command]:
    """Return the commands in the blocks of a page."""
    found = []
    for number, (language, content) in enumerate(blocks((ROOT / page).read_text())):
        if language in ("", "sh", "bash"):
            lines = re.sub(r"\s*\\\n\s*", " ", content).splitlines()
            found += [Command(page, number, line) for line in lines]
    return [command for command in found if command.plain]


def why_elsewhere(command: Command) -> str:
    """Return what runs a command in place of this; empty where it is typed here."""
    if command.plain.startswith("docker") or "CABLECAST_URSIM" in command.plain:
        return "the maker's simulator; nobody has run it yet"
    return ELSEWHERE.get(command.plain, "")


class Reader:
    """Somebody who types.

    Args:
        folder: The clone and, next to it, the log.
        later: Commands that contain one of these are left for another run.
    """

    def __init__(self, folder: pathlib.Path, later: Sequence[str] = ()):
        self.later = later
        self.clone, self.outputs = folder / "clone", folder / "typed"
        self.log, self.table = folder / "typed.jsonl", folder / "typed.md"
        self.servers: dict[str, subprocess.Popen[bytes]] = {}
        self.count = 0
        self.outputs.mkdir(parents=True, exist_ok=True)
        if not self.clone.exists():
            subprocess.run(["git", "clone", "--quiet", str(ROOT), str(self.clone)], check=True)

    def entries(self) -> list[dict[str, object]]:
        """Return what was typed, in order."""
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        return [json.loads(line) for line in lines]

    def start(
        self, line: str, where: pathlib.Path, output: pathlib.Path
    ) -> subprocess.Popen[bytes]:
        """Start a line in a group of its own."""
        active = self.clone / ".venv/bin/activate"
        script = f"[ -f {active} ] && . {active}; {line}"
        if line.startswith("pip "):
            fresh = self.outputs / "environment"
            script = f"python3 -m venv --clear {fresh} && . {fresh}/bin/activate && {line}"
        environment = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
        with output.open("ab") as stream:
            return subprocess.Popen(
                ["bash", "-c", script],
                cwd=where,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=environment,
            )

    def serve(self, line: str, where: pathlib.Path, output: pathlib.Path) -> int:
        """Start a server, and wait until it says where it is; the one before of its kind ends."""
        kind = next(kind for kind in SERVERS if line.startswith(kind))
        self.stop(kind)
        process = self.servers[kind] = self.start(line, where, output)
        until = time.monotonic() + SERVER_TIME
        while time.monotonic() < until and process.poll() is None:
            if re.search(r"listens on|page is at", output.read_text(errors="replace")):
                return 0
            time.sleep(0.2)
        return process.returncode or 1

    def stop(self, kind: str) -> None:
        """Stop a server as Ctrl-C does."""
        if process := self.servers.pop(kind, None):
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(timeout=SERVER_TIME)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                raise

    def type(self, line: str, where: pathlib.Path) -> tuple[int, float, pathlib.Path]:
        """Type a line, and return its status, its time [s] and the file with what it printed."""
        self.count += 1
        output = self.outputs / f"{time.strftime('%H%M%S')}-{self.count:03d}.txt"
        output.write_text(f"$ {line}\n")
        begin = time.monotonic()
        if line.startswith(SERVERS):
            return self.serve(line, where, output), time.monotonic() - begin, output
        process = self.start(line, where, output)
        try:
            status = process.wait()
        except BaseException:
            os.killpg(process.pid, signal.SIGTERM)
            raise
        return status, time.monotonic() - begin, output

    def type_page(self, page: str) -> bool:
        """Type the commands of a page, and return whether all ended well."""
        done = {(one["page"], one["line"]) for one in self.entries() if one["status"] in GOOD}
        well, where, block = True, self.clone, -1
        made = {start: lines for (name, start), lines in MADE.items() if name == page}
        for command in commands_of(page):
            if command.block != block:
                where, block = self.clone, command.block
            if reason := why_elsewhere(command):
                self.note(command, reason, 0.0)
                continue
            if any(text in command.line for text in self.later):
                continue
            for start in [start for start in made if command.plain.startswith(start)]:
                for line in made.pop(start):
                    status, _, output = self.type(line, self.clone)
                    if status:
                        raise RuntimeError(f"{line} before {command.line}: see {output}")
            if command.plain.startswith("cd "):
                where = where / command.plain[3:]
            elif (page, command.line) not in done or command.plain.startswith(SERVERS):
                status, seconds, _ = self.type(command.line, where)
                self.stop("cablecast view")
                self.note(command, status, seconds)
                well &= status in GOOD
        for kind in list(self.servers):
            self.stop(kind)
        return well

    def note(self, command: Command, status: int | str, seconds: float) -> None:
        """Add a command to the log."""
        entry = {
            "page": command.page,
            "line": command.line,
            "status": status,
            "seconds": round(seconds),
        }
        print(f"{command.page}: {command.line}\n  {status}, {seconds:.0f} s", flush=True)
        with self.log.open("a") as log:
            log.write(json.dumps(entry) + "\n")
        last = {(one["page"], one["line"]): one for one in self.entries()}.values()
        rows = [
            f"| {one['page']} | `{one['line']}` | {one['status']} | {one['seconds']} |"
            for one in last
        ]
        head = ["| page | command | exit status, or what runs it | time [s] |", "|---|---|---|---|"]
        self.table.write_text("\n".join([*head, *rows, ""]))


def pages_with_commands() -> Iterator[str]:
    """Yield README and the pages of docs that have commands."""
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        page = path.relative_to(ROOT).as_posix()
        if commands_of(page):
            yield page


def main() -> int:
    """Type what the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=pathlib.Path, help="for the clone and the log")
    parser.add_argument("--pages", nargs="+", choices=PAGES, default=PAGES)
    parser.add_argument("--later", nargs="+", default=(), help="leave out commands with this text")
    options = parser.parse_args()
    # A job in the background of a script ignores Ctrl-C, and so would what it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    reader = Reader(options.folder.resolve(), options.later)
    try:
        if not (reader.clone / ".venv/.installed").exists() and options.pages[0] != PAGES[0]:
            reader.type("make install", reader.clone)
        return int(not all([reader.type_page(page) for page in options.pages]))
    finally:
        for kind in list(reader.servers):
            reader.stop(kind)


if __name__ == "__main__":
    sys.exit(main())
