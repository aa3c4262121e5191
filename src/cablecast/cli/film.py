"""`cablecast film`: casts as a file to share."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import argument, picked
from cablecast.errors import InputError, check_count


@dataclasses.dataclass(frozen=True, kw_only=True)
class Film:
    """Film casts into one file, without a display.

    The ending of --out says the kind: an HTML file holds all that it needs to turn, zoom and play
    the scene in any browser; an MP4 or a GIF shows it from behind the robot. Casts are blue as they
    were seen, the simulator's purple. Takes about ten seconds a cast.
    Strikes in the air are filmed from the side, as MP4 or GIF.
    """

    casts: Annotated[pathlib.Path, argument("DIR")]
    """Folder that `cablecast aim`, `view`, `evaluate`, `collect` or `simulate` wrote."""
    out: Annotated[pathlib.Path, argument("FILE")]
    """File to write: .html, .mp4 or .gif."""
    select: Annotated[tuple[int, ...], argument("N [N ...]", "the last cast")] = ()
    """Numbers of the casts, from 0, in the order of the film."""
    width: int = 960
    """Width of the picture [pixel], even."""
    height: int = 540
    """Height of the picture [pixel], even."""
    fps: int = 25
    """Frames a second."""
    speed: float = 1.0
    """Shown seconds per second; 0.25 is slow motion."""
    force: bool = False
    """Overwrite the file if it exists."""

    def run(self) -> None:
        """Read the casts, and write the film."""
        from cablecast.cli.progress import console_progress
        from cablecast.engines.warp_ import EngineWarp
        from cablecast.pipeline.plan import check_writable
        from cablecast.report.words import counted
        from cablecast.view.film import KINDS, FilmConfig, write_film
        from cablecast.view.look import open_collection
        from cablecast.view.strike_film import strikes_in, write_strike_film

        if self.out.suffix.lower() not in KINDS:
            raise InputError(f"--out {self.out} must end in one of {', '.join(KINDS)}")
        check_writable(self.out, self.force)
        options = picked(self, "width", "height", "speed")
        config = FilmConfig(**options, frames_per_second=self.fps)
        if strikes := strikes_in(self.casts):
            last = len(strikes) - 1
            chosen = [check_count("cast", k, 0, last) for k in self.select or (last,)]
            with console_progress() as progress:
                write_strike_film(self.out, [strikes[k] for k in chosen], config, progress)
        else:
            collection = open_collection(self.casts)
            engine = EngineWarp()
            chosen = self.select or (len(collection) - 1,)
            shots = [collection.shot(index, engine) for index in chosen]
            with console_progress() as progress:
                write_film(self.out, collection.setup, shots, config, progress)
        size = self.out.stat().st_size
        print(f"film     {self.out} ({counted(len(chosen), 'cast')}, {size / 1e6:.2f} MB)")
