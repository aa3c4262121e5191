"""Controls to look at casts of a folder: measured and simulated side by side, with sliders."""

import dataclasses
import pathlib
import threading
from typing import Any

import numpy as np

from cablecast.cable import PARAM_BOUNDS, CableParams
from cablecast.dynamics import Dynamics
from cablecast.engines.base import Engine
from cablecast.errors import InputError
from cablecast.material import Material
from cablecast.view.figure import Figure
from cablecast.view.host import Host
from cablecast.view.look import Collection, open_collection
from cablecast.view.palette import BLUE, GREEN, PURPLE, VERMILLION, Color
from cablecast.view.shown import ShownCast

SLIDERS = (
    "bend_stiffness",
    "twist_stiffness",
    "mass",
    "endpoint_mass",
    "worksurface_friction",
    "rolling_friction",
    "linear_damping",
)
"""Parameters that have a slider; of both frictions the product alone counts."""

FACTOR_MAX = 10.0
"""Sliders multiply a parameter by up to this factor, or divide it."""

_COLORS: dict[str, Color] = {
    "measured": BLUE,
    "believed": VERMILLION,
    "tuned": GREEN,
    "sliders": PURPLE,
    "MuJoCo": (230, 159, 0),
}


def slid_params(base: CableParams, exponents: dict[str, float]) -> CableParams:
    """Return parameters multiplied by powers of ten, within their bounds.

    Args:
        base: Parameters where all sliders are at zero.
        exponents: Powers of ten by the name of the parameter, from -1 to 1.

    Raises:
        InputError: A name or a power is out of bounds: nothing from a browser is trusted.
    """
    changes = {}
    for name, exponent in exponents.items():
        if name not in PARAM_BOUNDS or not abs(exponent) <= np.log10(FACTOR_MAX) + 1e-9:
            raise InputError(f"slider {name} = {exponent:g} is outside [-1, 1]")
        low, high = PARAM_BOUNDS[name]
        value = float(np.asarray(getattr(base, name))) * 10.0**exponent
        changes[name] = float(np.clip(value, low, high))
    return dataclasses.replace(base, **changes)


class LookControls:
    """Folder, cast, kinds of motion that are shown, and sliders of the cable's parameters.

    Args:
        host: Page that the controls act on.
        folder: Folder that is suggested.
    """

    def __init__(self, host: Host, folder: pathlib.Path | None = None):
        self._host = host
        self._collection: Collection | None = None
        self._index = 0
        self._figures: dict[str, Figure] = {}
        self._shown: dict[str, ShownCast] = {}
        gui: Any = host.server.gui
        gui.add_markdown("Casts of `collect`, `tune`, `evaluate`, `simulate` or `aim`.")
        self._folder = gui.add_text("Folder", "" if folder is None else str(folder))
        gui.add_button("Open", color="blue", icon="folder-open").on_click(lambda _: self._open())
        self._cast = gui.add_dropdown("Cast", ("-",))
        self._cast.on_update(lambda _: self._choose())
        self._boxes = {
            name: gui.add_checkbox(name, name == "measured", disabled=True)
            for name in ("measured", "believed", "tuned", "sliders")
        }
        for name, box in self._boxes.items():
            box.on_update(lambda _, name=name: host.guard(lambda: self._show_kind(name)))
        self._mujoco = gui.add_button("Compare with MuJoCo", color="gray", disabled=True)
        self._mujoco.on_click(lambda _: host.guard(lambda: self._compare()))
        self._text = gui.add_markdown("")
        with gui.add_folder("Parameters of the cable (powers of ten)"):
            self._sliders = {
                name: gui.add_slider(name.replace("_", " "), -1.0, 1.0, 0.05, 0.0, disabled=True)
                for name in SLIDERS
            }
        for slider in self._sliders.values():
            slider.on_update(lambda event: self._slide() if event.client is not None else None)
        self._wake = threading.Event()
        threading.Thread(target=self._follow_sliders, name="sliders", daemon=True).start()

    def hide(self) -> None:
        """Clear the stage for a plan or a cast."""
        for figure in self._figures.values():
            figure.visible = False
        self._shown = {}

    def open(self, folder: str) -> None:
        """Show the casts of a folder.

        Raises:
            DatasetError: It holds none.
        """
        collection = open_collection(pathlib.Path(folder.strip()).expanduser())
        if not len(collection):
            raise InputError(f"{folder} holds no cast yet")
        if collection.setup.workspace != self._host.desk.setup.workspace:
            raise InputError("these casts were made on another table than the page shows")
        self._collection = collection
        self._cast.options = tuple(one.label for one in collection.casts)
        for slider in self._sliders.values():
            slider.disabled = False
        for name, box in self._boxes.items():
            box.disabled = name == "tuned" and collection.tuned is None
        self._mujoco.disabled = False
        self.show(0)

    def show(self, index: int) -> None:
        """Show a cast of the open folder in all kinds that are ticked."""
        self._host.clear_stage()
        self.hide()
        self._index = index
        kinds = [name for name, box in self._boxes.items() if box.value and not box.disabled]
        if self._need().casts[index].measured is None and "believed" not in kinds:
            self._boxes["believed"].value = True
            kinds.append("believed")
        for kind in kinds:
            self._make(kind)
        self._play()

    def _open(self) -> None:
        self._host.guard(lambda: self.open(str(self._folder.value)))

    def _choose(self) -> None:
        collection = self._collection
        if collection is None:
            return
        labels = [one.label for one in collection.casts]
        if self._cast.value in labels:
            index = labels.index(str(self._cast.value))
            self._host.guard(lambda: self.show(index))

    def _show_kind(self, kind: str) -> None:
        if self._collection is None:
            return
        if self._boxes[kind].value:
            self._make(kind)
        else:
            self._shown.pop(kind, None)
            if kind in self._figures:
                self._figures[kind].visible = False
        self._play()

    def _make(self, kind: str) -> None:
        """Compute what one kind of motion looks like."""
        collection, engine = self._need(), self._host.desk.engine
        if kind == "measured":
            measured = collection.casts[self._index].measured
            if measured is not None:
                self._shown[kind] = measured()
        elif kind == "believed":
            self._shown[kind] = collection.simulated(self._index, engine)
        elif kind == "tuned":
            self._shown[kind] = collection.simulated(self._index, engine, collection.tuned)
        else:
            self._shown[kind] = collection.simulated(self._index, engine, self._slid())

    def _compare(self) -> None:
        from cablecast.engines.mujoco_ import EngineMujoco

        engine: Engine = EngineMujoco()
        collection = self._need()
        # MuJoCo's cable has no material beside the ten parameters.
        plain = dataclasses.replace(collection.tuned or collection.believed, material=Material())
        self._shown["MuJoCo"] = collection.simulated(self._index, engine, plain)
        self._play()

    def _slide(self) -> None:
        self._boxes["sliders"].value = True
        self._wake.set()

    def _follow_sliders(self) -> None:
        """Simulate for the latest place of the sliders; places that were passed are left out."""
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._collection is not None:
                self._host.guard(self._resimulate)

    def _resimulate(self) -> None:
        self._make("sliders")
        player = self._host.player
        self._stage(player.time if not player.playing else self._shown["sliders"].duration)

    def _slid(self) -> Dynamics:
        base = self._need().tuned or self._need().believed
        factors = {name: float(slider.value) for name, slider in self._sliders.items()}
        return base.with_params(slid_params(base.params, factors))

    def _play(self) -> None:
        self._host.player.play(self._acts())
        self._describe()

    def _stage(self, time: float) -> None:
        self._host.player.show(self._acts(), time)
        self._describe()

    def _acts(self) -> list[tuple[Figure, ShownCast]]:
        acts = []
        for kind, cast in self._shown.items():
            if kind not in self._figures:
                self._figures[kind] = Figure(
                    self._host.server,
                    f"/look/{kind}",
                    self._need().setup,
                    _COLORS[kind],
                    with_arm=not acts,
                )
            self._figures[kind].visible = True
            acts.append((self._figures[kind], cast))
        return acts

    def _describe(self) -> None:
        """Say which colour is which, and how far each ends from the measured cast."""
        length = self._need().setup.cable.length
        ends = {kind: cast.endpoint_xy[-1] for kind, cast in self._shown.items()}
        lines = ["| motion | ends at | from measured |", "|---|---|---|"]
        for kind, end in ends.items():
            red, green, blue = _COLORS[kind]
            swatch = f'<span style="color: rgb({red},{green},{blue})">■</span> {kind}'
            apart = ""
            if "measured" in ends and kind != "measured":
                apart = f"{100 * float(np.linalg.norm(end - ends['measured'])) / length:.1f} %"
            lines.append(f"| {swatch} | {end[0]:.2f}, {end[1]:.2f} m | {apart} |")
        text = "\n".join(lines)
        if self._text.content != text:
            self._text.content = text

    def _need(self) -> Collection:
        if self._collection is None:
            raise InputError("no folder is open: name one, and open it")
        return self._collection
