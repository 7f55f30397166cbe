"""The task behind the spinning rotor's environments: a run-up and identifications of many rotors in one batch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_env.evaluation.score import ScoreTarget
from maglev_env.rotor.evaluation import RotorEvaluation, evaluate_rotors, identified_speeds, rotor_target
from maglev_env.rotor.identification import MODES
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.task.gain_box import TUNED, GainBox
from maglev_env.task.observation import decades, ratio
from maglev_env.task.pump_episodes import (
    RotorEpisode,
    check_draw,
    controlled,
    draw_rotor_episode,
    gains_at,
    preset_of,
    rotor_box,
)
from maglev_env.task.task import Task, check_episode

LADDER = tuple(range(0, 14_001, 1000))  # rpm
UNBALANCE = (0.5, 2.0)  # range of the factors that "tolerances" draws
# Quantities of each identification, per mode and per controller, in the order of the observation.
_OF_MODES = ("stiffness", "damping", "stiffness_se", "damping_se")
_OF_CONTROLLERS = ("peak_sensitivity", "peak_frequency")


@dataclass(frozen=True, eq=False)
class RotorLayout:
    """The elements of an observation.

    Args:
        speeds: of the run-up, (s,), rpm.
        id_speeds: of the identifications, (k,), rpm.
        controllers: their names.
        gains: names of the gains that are tuned.
        target: of the nominal rotor, by which stiffness and damping are scaled.
        budget: number of experiments in an episode.
    """

    speeds: tuple[float, ...]
    id_speeds: tuple[float, ...]
    controllers: tuple[str, ...]
    gains: tuple[str, ...]
    target: ScoreTarget
    budget: int

    def identified(self, name: str) -> tuple[str, ...]:
        """Names of one quantity's elements, by speed and then by mode or controller."""
        of = MODES if name in _OF_MODES else self.controllers
        return tuple(f"{name}_{one}_{speed:g}_rpm" for speed in self.id_speeds for one in of)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each element, in order."""
        found = [n for name in (*_OF_MODES, "peak_sensitivity") for n in self.identified(name)]
        displacement = [f"displacement_{speed:g}_rpm" for speed in self.speeds]
        return (*found, *displacement, "current", "feasible", *self.gains, "experiments_left")

    def encode(self, e: RotorEvaluation, actions: np.ndarray, experiments_left: np.ndarray) -> np.ndarray:
        """Observations of n experiments.

        After a touchdown ratios are 0, standard errors and the displacement 1, and peak sensitivities -1.

        Args:
            e: results of the experiments.
            actions: (n, k).
            experiments_left: (n,).

        Returns:
            (n, len(names)), float32.
        """
        n, t = len(e.score), self.target
        parts = [ratio(e.identified(name) / getattr(t, name)) for name in ("stiffness", "damping")]
        parts += [decades(e.identified(f"{name}_se") / getattr(t, name), -4, 1) for name in ("stiffness", "damping")]
        parts += [-decades(e.identified("peak_sensitivity"), 0, np.log10(20.0))]
        parts += [
            decades(e.run_up.peak.max(axis=-1) / t.clearance, -3, 0),
            decades(e.current_rms / t.current_limit, -3, 1),
        ]
        parts += [np.where(e.feasible, 1.0, -1.0), actions, 2 * experiments_left / self.budget - 1]
        rows = np.concatenate([np.reshape(part, (n, -1)) for part in parts], axis=1)
        return np.clip(rows, -1.0, 1.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class RotorTask:
    """Checked arguments of `envs.pump.PumpRotorEnv`; preset: the rotor's own gains as an action (k,)."""

    rotor: Rotor
    tuned: tuple[str, ...]
    box: GainBox
    preset: np.ndarray
    layout: RotorLayout
    randomization: str
    unbalance: tuple[float, float]
    budget: int
    terminate_on_touchdown: bool
    move: float | None

    tried = Task.tried

    @property
    def name(self) -> str:
        """Name of the rotor."""
        return self.rotor.name

    def draw(self, rng: np.random.Generator) -> RotorEpisode:
        """A new episode; all its random numbers come from rng."""
        return draw_rotor_episode(self.rotor, self.preset, self.randomization, self.unbalance, rng)

    def measure(
        self, episodes: Sequence[RotorEpisode], actions: np.ndarray, counts: Sequence[int], threads: int | None
    ) -> tuple[RotorEvaluation, np.ndarray]:
        """One experiment of each episode.

        Args:
            episodes: n of them.
            actions: (n, k).
            counts: number of the experiment in each episode; 0 is the start.
            threads: None: all cores.

        Returns:
            The evaluation, and observations (n, size).
        """
        every = zip(episodes, self.box.gains(actions), strict=True)
        rotors = [gains_at(episode.rotor, gains, self.tuned) for episode, gains in every]
        seeds = [(episode.seed, count) for episode, count in zip(episodes, counts, strict=True)]
        own = self.layout
        found = evaluate_rotors(
            rotors, np.array(own.speeds), own.id_speeds, seed=seeds, threads=threads, target=own.target
        )
        return found, own.encode(found, actions, self.budget - np.asarray(counts))

    def told(self, found: RotorEvaluation) -> dict[str, np.ndarray]:
        """Identified values, run-up, poles, zones and the score, arrays (n, ...) by name."""
        columns = {}
        for name in (*_OF_MODES, *_OF_CONTROLLERS):
            values = found.identified(name).reshape(len(found.score), -1).T
            columns |= dict(zip(self.layout.identified(name), values, strict=True))
        up = {name: getattr(found.run_up, name) for name in ("peak", "once", "coil_rms", "copper_loss")}
        return columns | up | {name: getattr(found, name) for name in _TOLD}


_TOLD = (
    *("peak_displacement", "current_rms", "peak_sensitivity", "displacement_zone", "sensitivity_zone"),
    *("touchdown_time", "touchdown_speed", "pole_radius", "feasible", "score"),
)


def make_rotor_task(
    rotor: str | Path | Rotor = "pump",
    control: str = "translation_tilt",
    tuned: Sequence[str] | None = TUNED,
    bounds: Mapping[str, Sequence[float]] | None = None,
    randomization: str = "none",
    unbalance: Sequence[float] = UNBALANCE,
    speeds: Sequence[float] = LADDER,
    budget: int = 10,
    terminate_on_touchdown: bool = False,
    move: float | None = None,
) -> RotorTask:
    """The task of checked arguments, see `envs.pump.PumpRotorEnv`.

    Raises:
        ValueError: An argument is not valid; the message names it.
        OSError: The rotor's file cannot be read.
    """
    loaded = rotor if isinstance(rotor, Rotor) else load_rotor(rotor)
    check_episode(budget, move)
    factors = check_draw(loaded, randomization, unbalance)
    try:
        ladder = np.asarray(speeds, dtype=float)
    except (TypeError, ValueError):
        ladder = np.empty(0)
    if ladder.ndim != 1 or not ladder.size or not np.isfinite(ladder).all() or np.unique(ladder).size < ladder.size:
        raise ValueError(f"speeds = {speeds!r}; give one or more different finite numbers, rpm")
    loaded, tuned = controlled(loaded, control), TUNED if tuned is None else tuned
    box = rotor_box(loaded, control, tuned, bounds)
    at = tuple(identified_speeds(loaded, ladder).tolist())
    layout = RotorLayout(
        tuple(map(float, ladder)), at, tuple(loaded.gains), box.names, rotor_target(loaded, at), budget
    )
    names, ends = tuple(tuned), bool(terminate_on_touchdown)
    preset = preset_of(loaded, names, box)
    return RotorTask(loaded, names, box, preset, layout, randomization, factors, budget, ends, move)
