"""Identify first, then search on the result: the parameters are fitted within their spread, gains on the model."""

from dataclasses import replace

import numpy as np

from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.goal import MATCH
from maglev_env.task.episodes import Episode, log_spread, wide_factors
from maglev_env.task.task import Task
from tuning.search.evolution import DifferentialEvolution
from tuning.search.optimum import searched_optimum
from tuning.study.study import experiments
from tuning.tuner import Trials

STEPS, STEP, FAR = 4, 0.02, 0.25  # Gauss-Newton: number of steps, finite difference, largest step
AGAIN, MOST = 1.25, 24  # refit when the data have grown by 25 %, up to this number of experiments
FLOOR, PEAK_ERROR, PHASE_ERROR = 0.005, 0.03, 2.0  # errors of the model itself: relative, relative, degrees
SEARCH, GENERATIONS, JITTER = 8, 14, 0.05  # population per gain, generations, noise that separates repeated points

MODEL = 31415  # mixed into the seed so that the model's noise differs from that of the experiments


class ModelBased:
    """Tries a safe start, then fits a simulated rig to all results so far and asks for the gains that score best on it.

    Mass, actuator gain, stiffness and lags are fitted by nonlinear least squares with their spread as prior.
    """

    def __init__(self, task: Task, episode: Episode, seed: int) -> None:
        """Set up for a rig.

        Of the episode only its target and start are used, and the task's effects are not: the tuner does not know which
        rig was drawn and what effects it has.
        """
        self._task = replace(task, effects={})
        # What a goal measures beyond the identification is not fitted, and is left out there.
        self._identified = replace(self._task, layout=replace(task.layout, goal=None))
        self._rng = np.random.default_rng((MODEL, seed))
        self._episode = Episode(task.rig, episode.target, episode.start, int(self._rng.integers(2**63)))
        factors = wide_factors(task.rig)
        self._names, self._spread = tuple(factors), np.array([log_spread(ends) for ends in factors.values()])
        self._told: Trials | None = None
        self._theta = np.zeros(len(self._names))
        self._best, self._due = np.asarray(episode.start, float), 1

    def ask(self, n: int) -> np.ndarray:
        k = len(self._task.box.names)
        told = 0 if self._told is None else len(self._told)
        if self._due <= told <= MOST:
            self._fit()
            self._best, self._due = self._optimum(), int(np.ceil(AGAIN * told + 0.5))
        best, spread = self._best, JITTER if told else 0.0
        points = best + spread * self._rng.standard_normal((n, k))
        points[0] = best
        if told and np.min(np.linalg.norm(self._told.points - best, axis=1)) < JITTER / 2:
            points[0] += spread * self._rng.standard_normal(k)
        return np.clip(points, -1.0, 1.0)

    def tell(self, trials: Trials) -> None:
        self._told = trials if self._told is None else self._told + trials

    @property
    def parameters(self) -> dict[str, float]:
        """The rig's identified parameters, relative to the nominal ones."""
        return dict(zip(self._names, map(float, np.exp(self._theta)), strict=True))

    def _model(self, theta: np.ndarray) -> Episode:
        factors = dict(zip(self._names, map(float, np.exp(theta)), strict=True))
        return replace(self._episode, rig=scaled_rig(self._task.rig, factors))

    def _fitted(self, theta: np.ndarray) -> Episode:
        """The model as the fit needs it."""
        model = self._model(theta)
        return replace(model, rig=replace(model.rig, target=replace(model.rig.target, goal=MATCH)))

    def _fit(self) -> None:
        """Fit all parameters; each moves in lanes beside the others, under noise of the same seeds."""
        known = np.flatnonzero(~self._told.touchdown)
        if not known.size:
            return
        measured = [self._features(self._told.info[i]) for i in known]
        points = self._told.points[known]
        moves = np.vstack([np.zeros(self._theta.size), STEP * np.eye(self._theta.size)])
        for _ in range(STEPS):
            models = [self._fitted(self._theta + move) for move in moves]
            lanes = [m for m in models for _ in known]
            found = experiments(
                self._identified, lanes, np.tile(points, (len(moves), 1)), [int(i) + 1 for i in known] * len(moves)
            )
            columns = np.array([np.concatenate(part) for part in self._residuals(found, measured, len(moves))])
            r, jacobian = columns[0], (columns[1:] - columns[0]) / STEP
            normal = jacobian @ jacobian.T + np.diag(self._spread**-2)
            step = -np.linalg.solve(normal, jacobian @ r + self._theta / self._spread**2)
            self._theta = self._theta + np.clip(step, -FAR, FAR)

    def _residuals(self, found: Trials, measured: list, lanes: int) -> list[list[np.ndarray]]:
        """Whitened residuals of each experiment for each set of lanes; 0 where either side is unknown."""
        rows = []
        for i in range(lanes):
            own = found.info[i * len(measured) : (i + 1) * len(measured)]
            pairs = zip(map(self._features, own), measured, strict=True)
            rows.append([np.nan_to_num((modelled - y) / sd) for (modelled, _), (y, sd) in pairs])
        return rows

    def _optimum(self) -> np.ndarray:
        """Best-scoring point on the model."""
        model, k = self._model(self._theta), len(self._task.box.names)
        search = DifferentialEvolution(k, int(self._rng.integers(2**31)), SEARCH)
        return searched_optimum(self._task, model, search, GENERATIONS, np.asarray(self._episode.start))

    def _features(self, info: dict) -> tuple[np.ndarray, np.ndarray]:
        """Identified values of an experiment and their standard deviations including model error; nan: unknown."""
        unknown = np.full(len(self._task.layout.bands), np.nan)
        values, errors = [], []
        for name in ("band_stiffness", "band_damping"):
            y = np.asarray(info.get(name, unknown), float)
            values.append(y)
            floor = FLOOR * np.nanmax(np.abs(y)) if np.isfinite(y).any() else 1.0
            errors.append(np.hypot(info.get(f"{name}_se", unknown), floor))
        values.append([np.log(info.get("peak_sensitivity", np.nan)), info.get("phase_margin", np.nan)])
        errors.append([PEAK_ERROR, PHASE_ERROR])
        return np.concatenate(values), np.concatenate(errors)
