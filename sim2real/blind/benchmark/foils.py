"""Two simple methods that any diagnosis must beat: one finds nothing, one refits parameters and names one of them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from maglev_env.loop.effect import EFFECTS
from sim2real.blind.cases import DIAGNOSIS_SCHEMA
from sim2real.compared.point import tolerances
from sim2real.compared.problem import assemble
from sim2real.recorded.records import read_records
from sim2real.search.fit import real_product
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis, single_effects

LEVEL = 0.01  # of the test by which the refit finds no gap
REFITTED = (
    "delay",
    "amplifier_lag",
    "actuator_gain",
    "negative_stiffness",
    "sensor_gain",
    "sensor_lag",
    "damping",
    "mass",
)
_STEPS = 12


def nothing(campaign: Path) -> dict[str, Any]:
    """Says of every campaign that there is no gap."""
    return _diagnosis("no_gap", None)


def refit(campaign: Path) -> dict[str, Any]:
    """Fits all parameters that a plain model has, together, and names the one that moved by most standard errors.

    It finds no gap if a chi-square test does not reject the rig within its tolerances.

    Raises:
        ValueError: The campaign cannot be read, or the nominal rig does not levitate in it.
    """
    loaded, records = read_records(campaign)
    problem = assemble([r for r in records if r.role == "fit"])
    rig = loaded.rig
    names = tuple(name for name in REFITTED if name in single_effects(rig))
    calibrated = Hypothesis((), tolerances(rig), scales=rig.scales)
    free = Hypothesis(names, {}, scales=rig.scales)
    fits = begin([calibrated, free], [np.zeros(calibrated.size), np.zeros(free.size)], problem.data, problem.simulate)
    if not all(np.isfinite(fit.cost) for fit in fits):
        raise ValueError(f"{campaign}: the nominal rig does not levitate under the recorded gains")
    for fit in fits:
        iterate([fit], problem.data, problem.simulate, _STEPS)
    within, fitted = fits
    if within.cost < chi2.isf(LEVEL, 2 * problem.data.size):
        return _diagnosis("no_gap", None)
    differentiate([fitted], problem.data, problem.simulate, True)
    normal = real_product(fitted.jacobian, fitted.jacobian)
    errors = np.sqrt(np.diag(np.linalg.pinv(normal)))
    moved = np.divide(np.abs(fitted.u), errors, out=np.zeros(free.size), where=errors > 0)
    return _diagnosis("explained", free.coordinates[int(np.argmax(moved))].effect)


def _diagnosis(verdict: str, effect: str | None) -> dict[str, Any]:
    return {
        "schema": DIAGNOSIS_SCHEMA,
        "verdict": verdict,
        "cause": [] if effect is None else [effect],
        "where": {"blocks": _blocks(effect)},
        "which": [{"effects": [effect or "none"], "probability": 1.0}],
        "gap": {},
    }


def _blocks(effect: str | None) -> Mapping[str, float]:
    return {} if effect is None else {EFFECTS[effect].block: 1.0}
