"""AimLearning: how the model of a session comes about: a fit, simulated casts, training."""

import dataclasses
import pathlib
from typing import Any

from cablecast.data.dataset import Dataset
from cablecast.errors import InputError, check_count, check_seed
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.aim_fits import fit_folder
from cablecast.pipeline.places import require
from cablecast.pipeline.simulate import simulate_to_aim
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.runs.places import DATASET_FOLDER, MODEL_FOLDER, TUNE_FOLDER
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.tuning.tuned import Tuned, load_tuned

CANDIDATE_COUNT = 20_000
"""Motions to choose from: fewer than `train` predicts, for a quick first plan."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Learned:
    """Model that a session plans with, and where it comes from.

    Attributes:
        policy: Policy of simulated casts alone.
        tuned: Fit that they were simulated with; None for the believed cable.
        fitted_count: Casts of the session, from the first on, that the simulator was fitted to;
            those of the dataset that `tuned` came from where None. 0 for a simulator that waits for
            the first casts of the session.

    Raises:
        InputError: The policy has learned from real casts.
    """

    policy: ForwardSearchPolicy
    tuned: Tuned | None = None
    fitted_count: int | None = None

    def __post_init__(self):
        if self.policy.model.has_real_casts:
            raise InputError(
                "aiming learns from real casts itself: give it a policy of simulated casts alone"
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimLearning:
    """Settings of fits, simulated casts and training; the same for every fit of a session.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        count: Simulated casts that the model learns from.
        epochs: Largest number of passes over them.
        candidate_count: Motions to choose from.
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda": simulates casts and trains. Fits stay on the CPU, which plays
            their few hundred worlds faster.
        folder: Folder that keeps the results; none where None.

    Raises:
        InputError: A value is out of bounds.
        MissingExtraError: A library that training needs is missing.
    """

    setup: Setup
    count: int
    epochs: int
    candidate_count: int = CANDIDATE_COUNT
    seed: int = 0
    device: str = "cpu"
    folder: pathlib.Path | None = None

    def __post_init__(self):
        require("aiming", "torch", "safetensors")
        check_count("count", self.count, 50, ACTION_COUNT_MAX)
        check_count("candidate_count", self.candidate_count, 1, ACTION_COUNT_MAX)
        check_seed(self.seed)

    def learned(
        self,
        casts: Dataset | None,
        tuned: Tuned | None = None,
        progress: ProgressCallback = ignore,
    ) -> Learned:
        """Return the first model of a session.

        Args:
            casts: Casts to fit the simulator to; None for the believed cable.
            tuned: Fit to simulate with, in place of one to the casts.
            progress: Told how far each step is.
        """
        waits = tuned is None and casts is None
        if casts is not None and tuned is None:
            tuned = self._fitted(casts, self.folder, progress)
        elif tuned is None:
            tuned = Tuned.believed(self.setup, self.seed)
        policy = self._policy(tuned, self.folder, progress)
        return Learned(policy=policy, tuned=tuned, fitted_count=0 if waits else None)

    def learned_anew(
        self, casts: Dataset, count: int, progress: ProgressCallback = ignore
    ) -> Learned:
        """Return the model of a later fit; one that was stopped goes on where it was.

        Args:
            casts: Casts to fit the simulator to, all of which count.
            count: Number of casts of the session, which names the folder of the fit.
            progress: Told how far each step is.
        """
        place = None if self.folder is None else fit_folder(self.folder, count)
        tuned = self._fitted(casts, place, progress, validation_count=0)
        policy = self._policy(tuned, place, progress)
        return Learned(policy=policy, tuned=tuned, fitted_count=count)

    def kept(self, count: int, progress: ProgressCallback = ignore) -> Learned:
        """Return the model of a later fit that is finished.

        Args:
            count: Number of casts of the session then.
            progress: Told how far each step is.

        Raises:
            InputError: A file of it is missing or damaged.
        """
        if self.folder is None:
            raise InputError("fits are kept in the folder of a session: it has none")
        place = fit_folder(self.folder, count)
        progress(Progress(task=f"2/4 fit to {count} casts", note=DONE_NOTE))
        tuned = load_tuned(place / TUNE_FOLDER, self.setup)
        policy = self._policy(tuned, place, progress)
        return Learned(policy=policy, tuned=tuned, fitted_count=count)

    def _fitted(
        self,
        casts: Dataset,
        place: pathlib.Path | None,
        progress: ProgressCallback,
        validation_count: int | None = None,
    ) -> Tuned:
        progress(Progress(task=f"2/4 fit to {len(casts)} casts"))
        return tune(
            casts,
            validation_count=validation_count,
            out=None if place is None else place / TUNE_FOLDER,
            progress=progress,
        )

    def _policy(
        self,
        tuned: Tuned | None,
        place: pathlib.Path | None,
        progress: ProgressCallback,
    ) -> ForwardSearchPolicy:
        shared: dict[str, Any] = {"seed": self.seed, "progress": progress}
        search: dict[str, Any] = {
            "candidate_count": self.candidate_count,
            "out": None if place is None else place / MODEL_FOLDER,
            **shared,
        }
        progress(Progress(task="3/4 simulate"))
        simulated = simulate_to_aim(
            self.setup,
            tuned,
            count=self.count,
            device=self.device,
            out=None if place is None else place / DATASET_FOLDER,
            **shared,
        )
        progress(Progress(task="4/4 train"))
        return train(simulated, epochs=self.epochs, device=self.device, **search)
