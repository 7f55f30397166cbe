"""A rig fitted to what experiments showed, with draws of what they leave open."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tuning.search.corrected.loops import LineModel, OpenLoop
from tuning.search.corrected.parameters import Parameters

STEP = 1e-3  # of a finite difference, ln of a factor or control samples
LINEAR_ERROR = 0.01  # relative error of a linear model of few parameters
# Standard deviations of logarithms, and of the phase margin in degrees, which include the model's own error.
# The upper gain margin is not among them: where the loop's gain is small, noise decides where it crosses.
LOGS = {"peak_sensitivity": 0.03, "gain_margin_low": 0.1, "current_rms": 0.03, "phase_margin_frequency": 0.03,
        "peak_frequency": 0.03, "disk_margin": 0.03}  # fmt: skip
PHASE = 1.5
DOUBTED = 2.0  # deviations from which a residual counts less than its square
STARTS, FIRST, STEPS = 40, 10, 3  # points from which the first fit may start, its steps, and those of one from the last
MOST_STEP, CONVERGED = 2.0, 0.01  # prior standard deviations: largest step, and one that ends the fit


def fitted(
    parameters: Parameters,
    models: Sequence[LineModel],
    points: np.ndarray,
    infos: Sequence[Mapping[str, Any]],
    start: np.ndarray,
    draws: int,
    rng: np.random.Generator,
    first: bool = True,
) -> np.ndarray:
    """Parameters (draws, p) by a robust fit to experiments: the best ones, then draws of what these leave open.

    Args:
        parameters: Names, priors and bounds.
        models: The lines, one for each axis.
        points: Points (n, k) that held.
        infos: What they showed.
        start: Where the fit starts, (p,).
        draws: Number of results.
        rng: Source of the draws.
        first: Whether all experiments are at one gain set.
    """
    axes = np.array([int(i.get("axis", 0)) % len(models) for i in infos])
    rows = {axis: np.flatnonzero(axes == axis) for axis in set(axes.tolist())}
    measured = {axis: _measured([infos[i] for i in own], len(models[axis].bands)) for axis, own in rows.items()}

    def cost(r: np.ndarray, theta: np.ndarray) -> float:
        soft = 2 * DOUBTED**2 * (np.sqrt(1 + (r / DOUBTED) ** 2) - 1)
        return float(soft.sum() + (prior * (theta - parameters.centre) ** 2).sum())

    def residuals(theta: np.ndarray) -> np.ndarray:
        rig, parts = parameters.rig_at(theta), []
        for axis, own in rows.items():
            shown = models[axis].values(models[axis].open(rig), points[own], whole=True)
            value, (y, sd) = _features(shown), measured[axis]
            parts.append(np.nan_to_num((value - y) / sd, nan=0.0, posinf=0.0, neginf=0.0).ravel())
        return np.concatenate(parts)

    prior = 1 / parameters.spread**2
    starts = [start]
    if first or len(infos) == 1:  # one gain set may be explained by quite different rigs: begin at the best of some
        drawn = parameters.centre + parameters.spread * rng.standard_normal((STARTS, parameters.spread.size))
        starts += list(drawn)
    starts = [np.clip(s, parameters.low, parameters.high) for s in starts]
    shown = [residuals(s) for s in starts]
    best = int(np.argmin([cost(r, s) for r, s in zip(shown, starts, strict=True)]))
    theta, r = starts[best], shown[best]
    for _ in range(FIRST if first or len(infos) == 1 else STEPS):
        jacobian = np.stack([(residuals(theta + step) - r) / STEP for step in STEP * np.eye(theta.size)], axis=1)
        weight = 1 / np.sqrt(1 + (r / DOUBTED) ** 2)
        information = (jacobian.T * weight) @ jacobian + np.diag(prior)
        gradient = jacobian.T @ (weight * r) + prior * (theta - parameters.centre)
        free = ~((theta <= parameters.low) & (gradient > 0) | (theta >= parameters.high) & (gradient < 0))
        step = np.zeros(theta.size)
        step[free] = -np.linalg.solve(information[np.ix_(free, free)], gradient[free])
        step /= max(1.0, np.abs(step / (MOST_STEP * parameters.spread)).max())
        for share in (1.0, 0.3, 0.1):
            tried = np.clip(theta + share * step, parameters.low, parameters.high)
            after = residuals(tried)
            if better := cost(after, tried) < cost(r, theta):
                break
        if not better:
            break
        moved, theta, r = np.abs(tried - theta) / parameters.spread, tried, after
        if moved.max() < CONVERGED:
            break
    known = r != 0
    misfit = float(np.mean(r[known] ** 2)) if known.any() else 1.0
    # What the model misses is not noise that averages: it widens what the fit leaves open, within the prior.
    data = (jacobian.T * weight) @ jacobian / max(1.0, misfit)
    others = rng.multivariate_normal(theta, np.linalg.inv(data + np.diag(prior)), draws - 1, method="eigh")
    return np.clip(np.vstack([theta, others]), parameters.low, parameters.high)


def _features(shown: Mapping[str, np.ndarray]) -> np.ndarray:
    """Features (m, n) of quantities."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = [np.log(shown[name]) for name in LOGS]
    columns = [shown["band_stiffness"], shown["band_damping"], np.stack([*logs, shown["phase_margin"]], axis=1)]
    return np.concatenate(columns, axis=1)


def _measured(infos: Sequence[Mapping[str, Any]], bands: int) -> tuple[np.ndarray, np.ndarray]:
    """Features (m, n) of experiments, and their standard deviations."""
    rows, errors = [], []
    for info in infos:
        own, sd = [], []
        for name in ("band_stiffness", "band_damping"):
            y = np.asarray(info.get(name, np.full(bands, np.nan)), float)
            floor = LINEAR_ERROR * np.nanmax(np.abs(y)) if np.isfinite(y).any() else 1.0
            own.append(y)
            sd.append(np.hypot(info.get(f"{name}_se", np.full(bands, np.inf)), floor))
        own.append([np.log(info.get(name, np.nan)) for name in LOGS] + [info.get("phase_margin", np.nan)])
        sd.append([*LOGS.values(), PHASE])
        rows.append(np.concatenate(own))
        errors.append(np.concatenate(sd))
    return np.array(rows), np.array(errors)


def opened(parameters: Parameters, models: Sequence[LineModel], thetas: np.ndarray) -> list[list[OpenLoop]]:
    """Open loops by draw and axis."""
    return [[model.open(parameters.rig_at(theta)) for model in models] for theta in thetas]
