"""The paper's experiments by `cablecast reproduce`, as a result that pages quote.

Its tables are those of the report. A folder of another version of the code is refused: its stages
would be of several versions.
"""

import dataclasses
import io
import pathlib
from collections.abc import Iterator

from benchmarks.pages import signed
from benchmarks.result import LEARNING, ROOT, Table, fingerprint, fingerprints_at
from cablecast.cli.progress import console_progress
from cablecast.engines import EngineName
from cablecast.errors import InputError
from cablecast.files import read_json, write_bytes
from cablecast.pipeline.reproduce import FULL, QUICK, reproduce
from cablecast.report.reproduction import Reproduction, reproduction_page
from cablecast.runs.folder import source_commit

FIGURES = {
    "coverage.png": "select/coverage.png",
    "tracks.png": "tune/tracks.png",
    "repeatability.png": "repeat/repeatability.png",
    "landings.png": "evaluate-fine-tuning/landings.png",
}
"""Figures of the first cable, by their names in docs/images."""
WIDTH, COLORS = 1100, 96
"""Width of a figure [pixel], and its number of colours."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Every experiment of the paper.

    Attributes:
        quick: One cable and less of everything.
        rig: Rig that makes the casts.
        engine: Simulator.
        seed: Seed of everything.
        out: Folder of the reproduction; work that was stopped goes on there.
    """

    quick: bool = False
    rig: str = "virtual:4"
    engine: EngineName = "warp"
    seed: int = 0
    out: pathlib.Path = pathlib.Path("runs/reproduce")


def main(args: Args) -> Iterator[Table]:
    """Reproduce, yield the tables of the report, and copy its figures into docs/images."""
    config = args.out / "config.json"
    if config.is_file():
        refuse_other_code(args.out, str(read_json(config)["commit"]).partition("+")[0])
    budget = QUICK if args.quick else FULL
    with console_progress() as progress:
        options = {"rig": args.rig, "engine": args.engine, "seed": args.seed}
        done = reproduce(args.out, budget=budget, **options, progress=progress)
    times = list(done.metrics["seconds"].items())
    results = Reproduction(folder=done.path, cables=budget.cables)
    for table in reproduction_page(results, read_json(config), times)[1]:
        rows = [
            tuple(f"**{cell}**" if row.kind == "ours" and cell else cell for cell in row.cells)
            for row in table.rows
        ]
        yield Table(table.title, table.heads, rows)
    if not args.quick:
        copy_figures(done.path / budget.cables[0])


def refuse_other_code(folder: pathlib.Path, commit: str) -> None:
    """Refuse a folder that was begun with other code.

    Raises:
        InputError: The code of a room that decides its results has changed since.
    """
    before = fingerprints_at(commit, LEARNING)
    if changed := [part for part, there in before.items() if there != fingerprint(part)]:
        raise InputError(
            f"{folder} was begun at commit {commit[:8]}, and the code of {', '.join(changed)} has "
            "changed since: give a new --out"
        )


def copy_figures(folder: pathlib.Path) -> None:
    """Write figures of a cable into docs/images, scaled to a page and to few colours."""
    from PIL import Image

    for name, source in FIGURES.items():
        with Image.open(folder / source) as picture:
            height = round(picture.height * WIDTH / picture.width)
            scaled = picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        buffer = io.BytesIO()
        scaled.quantize(COLORS).save(buffer, format="png", optimize=True)
        picture = signed(buffer.getvalue(), f"reproduce {source_commit()}")
        write_bytes(ROOT / "docs" / "images" / name, picture)
