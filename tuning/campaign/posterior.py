"""What is known of a rig's parameters where a linear model errs smoothly, and not at every line by itself."""

from collections.abc import Sequence

import numpy as np
import scipy

from maglev_env.loop.gains import controller_response
from maglev_env.rig.rig import Rig
from tuning.campaign.differences import agreed, binned, covariance, differences, likely, places
from tuning.campaign.gain_set import GainSet, Response
from tuning.campaign.opened import lags, open_responses, opened
from tuning.search.corrected.parameters import fitted_rig

STEP = 1e-3  # of a finite difference, ln of a factor or control samples


def posterior(
    rig: Rig,
    names: Sequence[str],
    theta: np.ndarray,
    expected: tuple[np.ndarray, np.ndarray],
    bounds: tuple[np.ndarray, np.ndarray],
    sets: Sequence[GainSet],
) -> tuple[np.ndarray, np.ndarray]:
    """The likeliest parameters (p,) and their covariance (p, p), where differences are smooth and not independent.

    A model that is 1 % off at one line is 1 % off at its neighbours, too, so many lines do not average that out. Plant
    and free receptance of all sets are compared with the model under noise and the covariance of `differences`.

    Args:
        rig: The nominal rig.
        names: Of the parameters.
        theta: From a fit under independent differences, (p,).
        expected: Centre and standard deviation of the priors, (p,) each.
        bounds: Least and largest values, (p,) each.
        sets: What was recorded.
    """
    plant = agreed([s.plant for s in sets if s.plant])
    shaken = [s for s in sets if s.receptance]
    wanted = np.unique(np.round(np.concatenate([c.frequency for s in sets for c in (s.plant, s.receptance) if c]), 9))
    first = fitted_rig(rig, names, theta)
    models, lag = open_responses(first, wanted), lags(first)
    curves = [] if plant is None else [(0, plant)]
    if shaken:
        moved = models[0] * (1 + _expected_difference(plant, models[0], wanted, lag)) if plant else models[0]
        z = np.exp(2j * np.pi * wanted / rig.control_rate)
        loops = [controller_response(s.gains, z, 1 / rig.control_rate) for s in shaken]
        curves.append((1, agreed(opened(shaken, loops, moved, wanted))))
    parts = []
    for kind, measured in curves:
        at = places(wanted, measured.frequency)
        noise = measured.variance / np.abs(models[kind][at]) ** 2
        ratio, variance, place = binned((measured.value / models[kind][at])[None], noise, measured.frequency)
        kinds, weights = likely(ratio[0] - 1, variance, place, lag)
        whole = covariance(place, kinds[int(weights.argmax())], lag) + np.diag(variance)
        parts.append((kind, at, measured.frequency, noise, ratio[0], np.linalg.cholesky(whole / 2)))

    def residuals(tried: np.ndarray) -> np.ndarray:
        now, found = open_responses(fitted_rig(rig, names, tried), wanted), []
        for kind, at, frequency, noise, ratio, root in parts:
            own = binned((now[kind][at] / models[kind][at])[None], noise, frequency)[0][0]
            left = scipy.linalg.solve_triangular(root, ratio - own, lower=True)
            found += [left.real, left.imag]
        return np.concatenate([*found, (tried - expected[0]) / expected[1]])

    def jacobian(tried: np.ndarray) -> np.ndarray:
        at = residuals(tried)
        return np.stack([(residuals(tried + step) - at) / STEP for step in STEP * np.eye(tried.size)], axis=1)

    inside = np.clip(theta, bounds[0] + 1e-9, bounds[1] - 1e-9)
    found = scipy.optimize.least_squares(residuals, inside, jacobian, bounds=bounds, x_scale=expected[1], max_nfev=20)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


def _expected_difference(plant: Response, model: np.ndarray, wanted: np.ndarray, lag: float) -> np.ndarray:
    """Likeliest relative difference (w,) of the plant from a model (w,)."""
    return differences(plant, model[None], wanted, wanted, lag, np.random.default_rng(0))[0][0]
