"""A rig's parameters fitted to the measured responses of all its gain sets, with their covariance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import EFFECTS, effect_value
from maglev_env.loop.gains import PidGains, controller_response
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.task.episodes import WIDE, log_spread, wide_factors
from tuning.campaign.gain_set import GainSet
from tuning.campaign.opened import open_responses
from tuning.campaign.posterior import STEP, posterior
from tuning.search.corrected.parameters import DELAY_SPREAD, FACTORS, LAGS, fitted_rig, most_lag, seen_in_loop

EFFECT_SPREAD = 0.5  # prior standard deviation of ln of a parameter of an effect that the diagnosis has named
MODEL_ERROR = 0.01  # relative error of a linear model of few parameters, at any line
LEAST_LAG = 1e-4  # control samples; a shorter lag is none
MASS = 0.01  # relative standard deviation of a mass without a stated tolerance: it is weighed
STATED = 3.0  # standard deviations by which the mass may differ from the stated one
# Misfit above which the model is wrong. Noise and MODEL_ERROR at every line leave 0.5 to 1; a friction of 0.5 % of the
# weight or a second body of 14 % of the mass leave 5 to 8, and the diagnosis tells which of them it is.
CONTRADICTED = 2.0


@dataclass(frozen=True, eq=False)
class IdentifiedRig:
    """A rig identified from recordings.

    Attributes:
        nominal: The nominal rig.
        names: Names (p,) of the fitted parameters, LAGS last.
        theta: Values (p,): ln of parameter over nominal, and of LAGS the control samples.
        covariance: Covariance (p, p) of noise and of smooth differences between any linear model and the rig.
        heavier: ln of the mass over the nominal one that the recordings look like, at most STATED standard deviations.
        misfit: Mean squared residual over what noise and MODEL_ERROR explain; about 1 or less where the model holds.
    """

    nominal: Rig
    names: tuple[str, ...]
    theta: np.ndarray
    covariance: np.ndarray
    heavier: float
    misfit: float

    @property
    def contradicted(self) -> bool:
        return self.misfit > CONTRADICTED

    @property
    def other_mass(self) -> bool:
        """Whether the recordings look like another mass than the stated one."""
        return abs(self.heavier) > 0.99 * STATED * stated_mass(self.nominal)

    def rig(self, theta: np.ndarray | None = None) -> Rig:
        """The rig at parameters theta (p,), by default the best; it has LAGS as effects."""
        return fitted_rig(self.nominal, self.names, self.theta if theta is None else theta)

    def drawn(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """theta (n, p) drawn from the posterior, which is normal within the bounds.

        Where a draw goes beyond a bound, all else follows it back, as the covariance says.
        """
        draws = rng.multivariate_normal(self.theta, self.covariance, n, method="eigh")
        low, high = _bounds(self.nominal, self.names)
        for i, own in enumerate(self.covariance):
            beyond = np.clip(draws[:, i], low[i], high[i]) - draws[:, i]
            draws += beyond[:, None] * own / own[i]
        return _without_traces(np.clip(draws, low, high), self.names)

    def told(self) -> dict[str, tuple[float, float, float]]:
        """Name -> (value, standard error, nominal value), SI."""
        best, found = self.rig(), {}
        for i, name in enumerate(self.names):
            sd = float(np.sqrt(self.covariance[i, i]))
            if name in LAGS:
                dt = 1 / self.nominal.control_rate
                found[name] = self.theta[i] * dt, sd * dt, effect_value(self.nominal.effects, name)
            else:
                of, _, parameter = name.partition(".")
                value, nominal = (
                    effect_value(r.effects, of, parameter) if parameter else getattr(r, name)
                    for r in (best, self.nominal)
                )
                found[name] = value, sd * abs(value), nominal
        return {name: tuple(map(float, values)) for name, values in found.items()}


def fit_rig(rig: Rig, sets: Sequence[GainSet]) -> IdentifiedRig:
    """Fit the linearised loop's receptance and sensitivity to the measured ones, all sets together.

    Actuator gain, negative stiffness and every other parameter with a range or tolerance move on a logarithmic scale
    with a normal prior; the mass moves within its stated tolerance. LAGS are fitted too: every digital loop has a
    delay, and what a probe's filter or eddy currents add is another lag than the amplifier's.

    Raises:
        ValueError: No set shows anything.
    """
    sets = [s for s in sets if s.failed is None]
    if not sets:
        raise ValueError("no recording shows anything that a rig could be fitted to")
    gain, stiffness = linearise(force_law(rig))
    rig = with_parameters(rig, {"actuator_gain": gain, "negative_stiffness": stiffness})
    names, prior = _parameters(rig)
    centre = np.array([effect_value(rig.effects, n) * rig.control_rate if n in LAGS else 0.0 for n in names])
    frequency = np.unique(np.concatenate([c.frequency for s in sets for c in (s.receptance, s.sensitivity) if c]))
    z, dt = np.exp(2j * np.pi * frequency / rig.control_rate), 1 / rig.control_rate
    controllers = [controller_response(s.gains, z, dt) for s in sets]
    rows = []  # for each measured curve: controller, indices of its frequencies, kind, values and deviations
    for s, c in zip(sets, controllers, strict=True):
        for kind, curve in (("receptance", s.receptance), ("sensitivity", s.sensitivity)):
            if curve is not None:
                at = np.searchsorted(frequency, curve.frequency)
                sd = np.sqrt((curve.variance + (MODEL_ERROR * np.abs(curve.value)) ** 2) / 2)
                rows.append((c[at], at, kind, curve.value, sd))
    x = frequency * dt
    held = np.sinc(x) * np.exp(-1j * np.pi * x)  # the model's force is held, while the hold of the measured is removed

    def residuals(theta: np.ndarray) -> np.ndarray:
        loop = loop_response(Experiment(fitted_rig(rig, names, theta), rig.gains, ()), frequency)
        free = loop.receptance / loop.sensitivity / held
        parts = []
        for c, at, kind, value, sd in rows:
            s = 1 / (1 + c * loop.plant[at])
            miss = (value - (s if kind == "sensitivity" else s * free[at])) / sd
            parts += [miss.real, miss.imag]
        return np.concatenate([*parts, (theta - centre) / prior])

    def jacobian(theta: np.ndarray) -> np.ndarray:
        """By steps that do not shrink with a parameter: a delay may be zero."""
        at = residuals(theta)
        return np.stack([(residuals(theta + step) - at) / STEP for step in STEP * np.eye(theta.size)], axis=1)

    least, most = _bounds(rig, names)
    if "mass" in names:
        at = names.index("mass")
        least[at], most[at] = -STATED * prior[at], STATED * prior[at]
    start = np.where(np.isin(names, list(LAGS)), np.maximum(centre, 0.2), 0.0)  # inside the bounds
    found = scipy.optimize.least_squares(residuals, start, jacobian, bounds=(least, most), x_scale=prior, max_nfev=40)
    data = found.fun[: -len(names)]
    misfit = float(data @ data / max(data.size - len(names), 1))
    theta, spread = posterior(rig, names, found.x, (centre, prior), (least, most), sets)
    heavier = float(found.x[names.index("mass")]) if "mass" in names else 0.0
    return IdentifiedRig(rig, names, _without_traces(theta, names), spread, heavier, misfit)


def _without_traces(theta: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Parameters (..., p) whose lags are none where they are hardly any: a pole that fast is lost in rounding."""
    return np.where(np.isin(names, list(LAGS)) & (theta < LEAST_LAG), 0.0, theta)


def _bounds(rig: Rig, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values (p,) of parameters."""
    most = np.array([most_lag(rig, n) if n in LAGS else np.log(FACTORS) for n in names])
    return np.where(np.isin(names, list(LAGS)), 0.0, -most), most


def _parameters(rig: Rig) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the fitted parameters, LAGS last, and their prior standard deviations (p,)."""
    ranges: Mapping[str, tuple[float, float]] = {
        **dict.fromkeys(("mass", "actuator_gain", "negative_stiffness", "amplifier_time_constant"), WIDE),
        **wide_factors(rig),
    }
    frequency = np.geomspace(1e-4, 0.2, 12) * rig.control_rate
    names = [name for name in ranges if getattr(rig, name) and seen_in_loop(rig, name, frequency)]
    spread = [stated_mass(rig) if n == "mass" else log_spread(ranges[n]) for n in names]
    own = _of_effects(rig)
    return (*names, *own, *LAGS), np.array([*spread, *(EFFECT_SPREAD,) * len(own), *(DELAY_SPREAD,) * len(LAGS)])


def _of_effects(rig: Rig) -> tuple[str, ...]:
    """Parameters "effect.parameter" of the rig's effects that the linear loop shows, beside those of the rig itself."""
    frequency = np.geomspace(1e-4, 0.45, 400) * rig.control_rate
    names = [
        f"{name}.{parameter}"
        for name, own in rig.effects.items()
        if name not in LAGS and not hasattr(rig, EFFECTS[name].nominal or name)
        for parameter, value in own.items()
        if value
    ]
    nominal = open_responses(rig, frequency)
    return tuple(
        n
        for n in names
        if any(
            not np.allclose(a, b, 1e-6, 0)
            for a, b in zip(nominal, open_responses(fitted_rig(rig, (n,), np.array([0.01])), frequency), strict=True)
        )
    )


def stated_mass(rig: Rig) -> float:
    """Relative standard deviation of the mass as the recordings show it: the rotor was weighed, the probe calibrated.

    A probe that reads too much makes every response look like that of a lighter rotor.
    """
    return float(np.hypot(rig.tolerance.get("mass", MASS), rig.tolerance.get("probe_gain", 0.0)))


def measured_sensitivity(
    plant: np.ndarray, variance: np.ndarray, frequency: np.ndarray, gains: PidGains, control_rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """S = 1 / (1 + C P) and its variance, (n,) each, of other gains on a measured plant (n,)."""
    z = np.exp(2j * np.pi * frequency / control_rate)
    c = controller_response(gains, z, 1 / control_rate)
    s = 1 / (1 + c * plant)
    return s, np.abs(c * s**2) ** 2 * variance
