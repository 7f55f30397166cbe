"""A rig's parameters fitted to the measured responses of all its gain sets, with their covariance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect_value
from maglev_env.loop.gains import Gains, controller_response
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.task.episodes import WIDE, log_spread, wide_factors
from tuning.campaign.gain_set import GainSet
from tuning.search.corrected.parameters import DELAY_SPREAD, FACTORS, fitted_rig, most_delay, seen_in_loop

MODEL_ERROR = 0.01  # relative error of a linear model of few parameters, at any line
STEP = 1e-3  # of a finite difference, ln of a factor or control samples
MASS = 0.01  # relative standard deviation of a mass without a stated tolerance: it is weighed
STATED = 3.0  # standard deviations by which the mass may differ from the stated one
CONTRADICTED = 25.0  # misfit above which the model is wrong: residuals five times as large as noise and model error


@dataclass(frozen=True, eq=False)
class IdentifiedRig:
    """A rig identified from recordings.

    Attributes:
        nominal: The nominal rig.
        names: Names (p,) of the fitted parameters, "delay" last.
        theta: Values (p,): ln of parameter over nominal, and the delay in control samples.
        covariance: Covariance (p, p), scaled by the misfit where that exceeds 1.
        misfit: Mean squared residual over what noise and MODEL_ERROR explain; about 1 or less where the model holds.
    """

    nominal: Rig
    names: tuple[str, ...]
    theta: np.ndarray
    covariance: np.ndarray
    misfit: float

    @property
    def contradicted(self) -> bool:
        return self.misfit > CONTRADICTED

    @property
    def other_mass(self) -> bool:
        """Whether the recordings look like another mass than the stated one."""
        at = dict(zip(self.names, self.theta, strict=True)).get("mass", 0.0)
        return abs(at) > 0.99 * STATED * stated_mass(self.nominal)

    def rig(self, theta: np.ndarray | None = None) -> Rig:
        """The rig at parameters theta (p,), by default the best; it has the delay as an effect."""
        return fitted_rig(self.nominal, self.names, self.theta if theta is None else theta)

    def drawn(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """theta (n, p) drawn from the posterior, which is normal; negative delays are set to zero."""
        draws = rng.multivariate_normal(self.theta, self.covariance, n, method="eigh")
        draws[:, :-1] = np.clip(draws[:, :-1], -np.log(FACTORS), np.log(FACTORS))
        draws[:, -1] = np.clip(draws[:, -1], 0.0, most_delay(self.nominal))
        return draws

    def told(self) -> dict[str, tuple[float, float, float]]:
        """Name -> (value, standard error, nominal value), SI."""
        best, found = self.rig(), {}
        for i, name in enumerate(self.names):
            sd = float(np.sqrt(self.covariance[i, i]))
            if name == "delay":
                dt = 1 / self.nominal.control_rate
                found[name] = self.theta[i] * dt, sd * dt, effect_value(self.nominal.effects, "delay")
            else:
                value = getattr(best, name)
                found[name] = value, sd * abs(value), getattr(self.nominal, name)
        return {name: tuple(map(float, values)) for name, values in found.items()}


def fit_rig(rig: Rig, sets: Sequence[GainSet]) -> IdentifiedRig:
    """Fit the linearised loop's receptance and sensitivity to the measured ones, all sets together.

    Actuator gain, negative stiffness and every other parameter with a range or tolerance move on a logarithmic scale
    with a normal prior; the mass moves within its stated tolerance. A delay, which every digital loop has, is fitted
    too.

    Raises:
        ValueError: No set shows anything.
    """
    sets = [s for s in sets if s.failed is None]
    if not sets:
        raise ValueError("no recording shows anything that a rig could be fitted to")
    gain, stiffness = linearise(force_law(rig))
    rig = with_parameters(rig, {"actuator_gain": gain, "negative_stiffness": stiffness})
    names, prior = _parameters(rig)
    own_delay = effect_value(rig.effects, "delay") * rig.control_rate
    centre = np.array([0.0] * (len(names) - 1) + [own_delay])
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

    most = np.array([STATED * prior[i] if n == "mass" else np.log(FACTORS) for i, n in enumerate(names)])
    least = -most
    most[-1], least[-1] = most_delay(rig), 0.0
    start = np.append(np.zeros(len(names) - 1), max(own_delay, 0.2))  # inside the bounds
    found = scipy.optimize.least_squares(residuals, start, jacobian, bounds=(least, most), x_scale=prior, max_nfev=40)
    data = found.fun[: -len(names)]
    misfit = float(data @ data / max(data.size - len(names), 1))
    covariance = np.linalg.inv(found.jac.T @ found.jac) * max(1.0, misfit)
    return IdentifiedRig(rig, names, found.x, covariance, misfit)


def _parameters(rig: Rig) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the fitted parameters, the delay last, and their prior standard deviations (p,)."""
    ranges: Mapping[str, tuple[float, float]] = {
        **dict.fromkeys(("mass", "actuator_gain", "negative_stiffness", "amplifier_time_constant"), WIDE),
        **wide_factors(rig),
    }
    frequency = np.geomspace(1e-4, 0.2, 12) * rig.control_rate
    names = [name for name in ranges if getattr(rig, name) and seen_in_loop(rig, name, frequency)]
    spread = [stated_mass(rig) if n == "mass" else log_spread(ranges[n]) for n in names]
    return (*names, "delay"), np.array([*spread, DELAY_SPREAD])


def stated_mass(rig: Rig) -> float:
    """Relative standard deviation of the mass as the recordings show it: the rotor was weighed, the probe calibrated.

    A probe that reads too much makes every response look like that of a lighter rotor.
    """
    return float(np.hypot(rig.tolerance.get("mass", MASS), rig.tolerance.get("probe_gain", 0.0)))


def measured_sensitivity(
    plant: np.ndarray, variance: np.ndarray, frequency: np.ndarray, gains: Gains, control_rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """S = 1 / (1 + C P) and its variance, (n,) each, of other gains on a measured plant (n,)."""
    z = np.exp(2j * np.pi * frequency / control_rate)
    c = controller_response(gains, z, 1 / control_rate)
    s = 1 / (1 + c * plant)
    return s, np.abs(c * s**2) ** 2 * variance
