"""The task behind the environments: episodes and experiments in batches, the same for one environment or many."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from maglev_env.channels import SENSORS
from maglev_env.design.controllers import with_controller
from maglev_env.design.defaults import with_defaults
from maglev_env.design.goals import goal_of, with_goal
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.evaluation.requirements import events_of
from maglev_env.evaluation.score import ScoreTarget, stacked
from maglev_env.evaluation.target import score_target
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.fields import is_number
from maglev_env.loop.effect import Effects, as_effects, check_effects
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_env.task.episodes import Episode, check_randomization, draw_episode
from maglev_env.task.gain_box import GainBox, gain_box
from maglev_env.task.observation import BANDS, Layout
from maglev_env.task.protocol import env_protocol
from maglev_lanes.price import check_experiments

TOUCHDOWN_REWARD = -1.0


class Tuning(Protocol):
    """The task of an environment, as the environment uses it.

    An episode has a `start`, the first action. The result of `measure` has touchdown_time (n,), nan without one,
    score (n,) and terms. The layout has the names of the observation's elements.
    """

    @property
    def name(self) -> str: ...
    @property
    def box(self) -> GainBox: ...
    @property
    def layout(self) -> Any: ...
    @property
    def budget(self) -> int: ...
    @property
    def terminate_on_touchdown(self) -> bool: ...

    def tried(self, last: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Points of the box (..., k) that actions (..., k) select after the point `last`."""

    def draw(self, rng: np.random.Generator) -> Any:
        """A new episode."""

    def measure(
        self, episodes: Sequence[Any], actions: np.ndarray, counts: Sequence[int], threads: int | None
    ) -> tuple[Any, np.ndarray]:
        """Results and observations (n, size) of experiment counts[i] of each episode."""

    def told(self, found: Any) -> dict[str, np.ndarray]:
        """Results for the info, in addition to gains and terms: arrays (n, ...) by name."""


@dataclass(frozen=True, eq=False)
class Task:
    """Checked arguments of an environment, see `envs.single.RigEnv`."""

    rig: Rig
    box: GainBox
    layout: Layout
    target: ScoreTarget
    randomization: str
    draw_target: bool
    effects: Effects
    budget: int
    terminate_on_touchdown: bool
    move: float | None
    sensor: str

    @property
    def name(self) -> str:
        """Name of the rig."""
        return self.rig.name

    def tried(self, last: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Points of the box (..., k) after the point `last`: the actions, or with `move` steps from `last`."""
        return actions if self.move is None else np.clip(last + self.move * actions, -1.0, 1.0)

    def draw(self, rng: np.random.Generator) -> Episode:
        """A new episode; all its random numbers come from rng."""
        return draw_episode(self.rig, self.target, self.box, self.randomization, self.draw_target, rng)

    def measure(
        self, episodes: Sequence[Episode], actions: np.ndarray, counts: Sequence[int], threads: int | None
    ) -> tuple[Evaluation, np.ndarray]:
        """One experiment of each episode.

        Args:
            episodes: n of them.
            actions: (n, k).
            counts: number of the experiment in each episode; 0 is the start.
            threads: None: all cores.

        Returns:
            The evaluation, and observations (n, size).
        """
        gains = self.box.gains(actions)
        experiments = [self.experiment(e, g, count) for e, g, count in zip(episodes, gains, counts, strict=True)]
        targets = [e.target for e in episodes]
        found = evaluate(experiments, threads, targets=targets, bands=self.layout.bands)
        left = self.budget - np.asarray(counts)
        return found, self.layout.encode(found, stacked(targets), actions, left)

    def experiment(self, episode: Episode, gains: np.ndarray, count: int) -> Experiment:
        """Identification experiment number `count` of an episode, at gains (k,)."""
        rig, p = episode.rig, episode.rig.protocol
        tried = self.box.applied(rig.gains, gains)
        seed = (episode.seed, count)
        # The estimator of a drawn rig is designed for the nominal rig, because the drawn parameters are not known.
        sensor = "probe" if self.sensor == "probe" else rig_sensors(rig, self.rig)
        return Experiment(
            rig, tried, p.excitations, p.periods, p.transient_periods, self.effects, seed=seed, sensor=sensor
        )

    def told(self, found: Evaluation) -> dict[str, np.ndarray]:
        """Estimates, margins, also between the lines, peaks, the score and what a goal measures: (n, ...) by name."""
        of_goal = {
            f"required_{name}{end}": values
            for end in ("", "_low", "_high")
            for name, values in getattr(found, f"required{end}").items()
        }
        hidden = {f"between_lines_{name}": values for name, values in found.between_lines.items()}
        return {name: getattr(found, name) for name in _TOLD} | found.margins | hidden | of_goal


def make_task(
    rig: str | Path | Rig = "hmb_free",
    tuned: Sequence[str] | None = None,
    bounds: Mapping[str, Sequence[float]] | None = None,
    randomization: str = "none",
    draw_target: bool = False,
    effects: Mapping[str, Mapping[str, float] | float] | None = None,
    protocol: str = "full",
    sensor: str = "probe",
    budget: int = 10,
    terminate_on_touchdown: bool = False,
    move: float | None = None,
    goal: str | None = None,
    controller: str | None = None,
) -> Task:
    """The task of checked arguments, see `envs.single.RigEnv`.

    Raises:
        ValueError: An argument is not valid; the message names it.
        OSError: The rig's file cannot be read.
    """
    loaded = rig if isinstance(rig, Rig) else load_rig(rig)
    if not loaded.controlled:
        raise ValueError(f"rig = {loaded.name!r} has no controlled magnet: there are no gains to tune")
    if sensor not in SENSORS:
        raise ValueError(f"sensor = {sensor!r}; use one of {', '.join(SENSORS)}")
    check_episode(budget, move)
    loaded = with_controller(with_defaults(loaded), controller)
    effects = as_effects(effects or {})
    check_effects(effects, loaded)
    check_randomization(loaded, randomization)
    loaded = with_goal(loaded, goal)
    box = gain_box(loaded, tuned, bounds)
    # A rig with two axes is scored by the worse axis, against the target of x.
    target = score_target(axis_rig(loaded, 0))
    loaded = replace(loaded, protocol=env_protocol(loaded, protocol))
    p = loaded.protocol
    nominal = Experiment(loaded, loaded.gains, p.excitations, p.periods, p.transient_periods, effects, sensor=sensor)
    wanted = goal_of(loaded)
    if wanted:
        events_of(wanted, nominal)  # refuses a goal that cannot be tested beside this experiment
    layout = Layout(_bands(nominal), box.names, target, budget, draw_target, wanted)
    ends = bool(terminate_on_touchdown)
    return Task(loaded, box, layout, target, randomization, draw_target, effects, budget, ends, move, sensor)


def check_episode(budget: int, move: float | None) -> None:
    """Raise ValueError unless the budget is a number of experiments, and move is None or a share of the box."""
    if isinstance(budget, bool) or not isinstance(budget, int) or budget < 1:
        raise ValueError(f"budget = {budget!r} experiments; give a whole number, at least 1")
    check_experiments(budget, 0, "budget")
    if move is not None and not (is_number(move) and 0 < move <= 2):
        raise ValueError(f"move = {move!r}; give a share of the box above 0 and up to 2, or None")


def _bands(nominal: Experiment) -> np.ndarray:
    """BANDS bands (BANDS, 2) of equal width, Hz, over the force lines; every axis needs two lines in each band."""
    rig, frequency = nominal.rig, []
    for axis in range(rig.axes):
        own = axis_experiment(nominal, axis)
        lines = lines_at(own.excitations, "force")
        if not lines.size or not lines_at(own.excitations, "current").size:
            raise ValueError(f"rig {rig.name}: [protocol] needs an excitation at the force and one at the current")
        frequency.append(lines * own.fundamental)
    low, high = max(f[0] for f in frequency), min(f[-1] for f in frequency)
    edges = np.linspace(low, high, BANDS + 1)
    for f in frequency:
        if np.histogram(f, edges)[0].min() < 2:
            raise ValueError(f"rig {rig.name}: [protocol] has too few force lines for {BANDS} bands of two or more")
    return np.stack([edges[:-1], edges[1:]], axis=1)


def rewards(found: Any) -> np.ndarray:
    """Reward (n,): the score in [0, 1], 0 for an unstable loop, TOUCHDOWN_REWARD after a touchdown."""
    return np.where(np.isnan(found.touchdown_time), found.score, TOUCHDOWN_REWARD)


def infos(task: Tuning, found: Any, actions: np.ndarray) -> list[dict[str, Any]]:
    """Results of each experiment, SI: gains, estimates, margins, score and its terms; unknown values are left out."""
    gains = task.box.gains(actions)
    columns: dict[str, np.ndarray] = {name: gains[:, j] for j, name in enumerate(task.box.names)}
    columns |= task.told(found)
    columns |= {f"term_{name}": values for name, values in found.terms.items()}
    rows: list[dict[str, Any]] = [{} for _ in actions]
    for name, values in columns.items():
        plain = values.copy() if values.ndim > 1 else values.tolist()
        for row, value, known in zip(rows, plain, _known(values), strict=True):
            if known:
                row[name] = value
    return rows


_TOLD = (
    *("stiffness", "stiffness_low", "stiffness_high", "damping", "damping_low", "damping_high"),
    *("band_stiffness", "band_stiffness_se", "band_damping", "band_damping_se"),
    *("peak_displacement", "current_rms", "touchdown_time", "pole_radius", "feasible", "score", "axis"),
    *("gap_error_rms", "gap_error_bias", "gap_error_worst", "added_phase", "margin_lost"),
)


def _known(values: np.ndarray) -> np.ndarray:
    """Whether each of the n values (n, ...) is known completely, (n,)."""
    return values != "" if values.dtype.kind == "U" else ~np.isnan(values).any(axis=tuple(range(1, values.ndim)))
