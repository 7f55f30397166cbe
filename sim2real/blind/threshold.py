"""Size of an effect relative to the noise and the tolerances of a campaign: the power of chi-square tests.

A gap delta between mean spectra, in units of the noise of the means, is calibrated away as far as parameters within
their tolerances allow: the minimum over theta, in tolerances, of |delta - J theta|^2 + |theta|^2. This equals
delta^H Sigma^-1 delta, where Sigma is the noise plus J Lambda J^T. The remainder is tested with as many degrees of
freedom as there are values, the calibration with as many as there are parameters; without this second test, the many
values would hide that a parameter is off by ten tolerances. At the threshold the more sensitive of these 1 % tests has
a power of one half.

Effects that act otherwise where noise moves the loop (ROUGH) are measured by noisy simulations, with and without them;
of the others noise changes the size by less than a tenth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize, signal, stats

from sim2real.blind.excitation import FUNDAMENTAL, Drive
from sim2real.blind.forms import Effects, machine
from sim2real.blind.rigs import PID, RIGS
from sim2real.blind.twin import Truth, simulate

LEVEL, POWER = 0.01, 0.5
SUBSTEPS = 4  # coarser than in recordings, because both sides of a difference use the same step
STEP = 0.1  # step for the derivative, in units of a parameter's tolerance
STOCHASTIC_PERIODS = 8  # periods over which an effect that acts at random, or under noise, is averaged
ROUGH = frozenset({"hysteresis", "deadband", "amplifier_voltage_limit"})


def critical(freedom: int) -> float:
    """Non-centrality at which a chi-square test of LEVEL with these degrees of freedom has the power POWER."""
    limit = stats.chi2.isf(LEVEL, freedom)
    return optimize.brentq(lambda x: stats.ncx2.sf(limit, freedom, x) - POWER, 1e-3, 20 * limit)


@dataclass(frozen=True)
class Loop:
    """The undisturbed linear loop at some frequencies (n,).

    Attributes:
        sensitivity: From the probe's noise to its reading, including true over nominal gain.
        controller: Command over error.
        amplifier: Current over command.
        plant: Reading over command.
        compliance: Reading over a force with the loop open, m/N.
    """

    sensitivity: np.ndarray
    controller: np.ndarray
    amplifier: np.ndarray
    plant: np.ndarray
    compliance: np.ndarray


def linear_loop(truth: Truth, gains: PID, frequencies: np.ndarray) -> Loop:
    """The sampled loop of a truth without its effects, from the held command to the reading."""
    p = truth.parameters
    m = machine(p, {}, truth.forms)
    dt, ratio = 1 / m.rate, m.probe / m.probe_nominal
    stiffness = p["support_stiffness"] + p["negative_stiffness"]
    a = np.array(
        [
            [0, 1, 0, 0],
            [-stiffness / m.mass, -m.damper / m.mass, p["actuator_gain"] / m.mass, 0],
            [0, 0, -1 / m.amplifier, 0],
            [1 / m.sensor, 0, 0, -1 / m.sensor],
        ]
    )
    b = np.array([[0, 0], [0, 1 / m.mass], [1 / m.amplifier, 0], [0, 0]])
    c = np.array([[0, 0, 0, ratio], [0, 0, 1, 0]])
    ad, bd, *_ = signal.cont2discrete((a, b, c, np.zeros((2, 2))), dt)
    z = np.exp(2j * np.pi * frequencies * dt)
    response = c @ np.linalg.solve(z[:, None, None] * np.eye(4) - ad, np.broadcast_to(bd, (z.size, 4, 2)))
    lag_d, lag_i = ((1 - np.exp(-dt / t)) / (z - np.exp(-dt / t)) for t in (gains.td, gains.ti))
    controller = gains.kp + gains.kd / gains.td * (1 - lag_d) + gains.ki * lag_i
    sensitivity = ratio / (1 + response[:, 0, 0] * controller)
    return Loop(sensitivity, controller, response[:, 1, 0], response[:, 0, 0], response[:, 0, 1])


@dataclass(frozen=True)
class Detector:
    """A campaign as a test sees it.

    Attributes:
        truth: The undisturbed truth.
        recordings: The recordings to be fitted.
        periods: Number of periods kept of each.
        with_current: Whether the current is recorded beside the displacement; the command then adds no information.
    """

    truth: Truth
    recordings: Sequence[tuple[PID, Drive]]
    periods: int
    with_current: bool

    def whitened(
        self, effects: Effects, deviations: dict[str, float] | None = None, seed: int | None = None
    ) -> np.ndarray:
        """Mean spectra of all recordings in units of the noise's standard deviation, as one real row.

        Args:
            effects: The effects.
            deviations: Relative deviations of parameters; None: those of the truth.
            seed: Of the noise; None: without noise.
        """
        truth = replace(self.truth, effects=effects, deviations=deviations or self.truth.deviations)
        kept = STOCHASTIC_PERIODS if "dropped_samples" in effects or seed is not None else 1
        parts = []
        for n, (gains, drive) in enumerate(self.recordings):
            drawn = None if seed is None else (seed, n)
            channels = simulate(truth, gains, drive, 1 + kept, drawn, SUBSTEPS)
            parts.append(self.whiten(gains, drive, channels))
        return np.concatenate(parts)

    def whiten(self, gains: PID, drive: Drive, channels: dict[str, np.ndarray]) -> np.ndarray:
        """Whitened mean over all periods but the first.

        In the loop, the noise of the current contains that of the displacement; this part is subtracted.
        """
        n, lines, p = drive.force.size, drive.grid.lines, self.truth.parameters
        noise, loop = RIGS[self.truth.rig].noise, linear_loop(self.truth, gains, lines * FUNDAMENTAL)
        per_mean = np.sqrt(4 / (n * self.periods))  # standard deviation of a line's mean for unit noise per sample

        def spectrum(channel: str) -> np.ndarray:
            mean = channels[channel].reshape(-1, n)[1:].mean(axis=0)
            return np.fft.rfft(mean)[lines] * (2 / n)

        rounding = 2 * p["voltage_range"] / 2 ** p["dac_bits"] / np.sqrt(12)
        ratio, displacement = p["probe_gain"] / p["probe_nominal"], spectrum("displacement")
        shown = np.hypot(noise["displacement"], rounding * np.abs(loop.plant) / ratio)
        rows = [displacement / (np.abs(loop.sensitivity) * shown * per_mean)]
        if self.with_current:
            own = spectrum("current") + loop.amplifier * loop.controller * displacement
            rows.append(own / (np.hypot(noise["current"], rounding * np.abs(loop.amplifier)) * per_mean))
        z = np.sqrt(2) * np.concatenate(rows)
        return np.concatenate([z.real, z.imag])

    @cached_property
    def baseline(self) -> np.ndarray:
        return self.whitened({})

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Whitened change per tolerance of each uncertain parameter, (values, parameters)."""
        columns = []
        for name, tolerance in RIGS[self.truth.rig].tolerance.items():
            step = STEP * tolerance
            off = {**self.truth.deviations, name: self.truth.deviations.get(name, 0.0) + step}
            columns.append((self.whitened({}, off) - self.baseline) / STEP)
        return np.stack(columns, axis=1)

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Critical non-centralities of the remainder of a gap and of its calibration."""
        return critical(self.baseline.size), critical(len(RIGS[self.truth.rig].tolerance))

    @cached_property
    def noisy_baselines(self) -> list[np.ndarray]:
        return [self.whitened({}, seed=seed) for seed in range(2)]

    def size(self, effects: Effects) -> float:
        """The size of effects in multiples of the threshold."""
        if ROUGH.isdisjoint(effects):
            return self._size(self.whitened(effects) - self.baseline)
        # The chance in two differences of independent noise does not add to their product.
        return self._size(*(self.whitened(effects, seed=n) - base for n, base in enumerate(self.noisy_baselines)))

    def parameter_size(self, name: str, change: float) -> float:
        """Size of a relative change of one uncertain parameter, linearised; the others may absorb part of it."""
        tolerance = RIGS[self.truth.rig].tolerance
        return self._size(self.jacobian[:, list(tolerance).index(name)] * (change / tolerance[name]))

    def _size(self, *gaps: np.ndarray) -> float:
        """The size of a gap, of which there may be two estimates."""
        j, (remains, calibration) = self.jacobian, self.limits
        thetas = [np.linalg.solve(np.eye(j.shape[1]) + j.T @ j, j.T @ gap) for gap in gaps]
        rests = [gap - j @ theta for gap, theta in zip(gaps, thetas, strict=True)]
        shown = max(rests[0] @ rests[-1] / remains, thetas[0] @ thetas[-1] / calibration)
        return float(np.sqrt(max(shown, 0.0)))

    def drift_size(self, change: float) -> float:
        """Size of an actuator gain that drifts by a relative change over the recording: scatter over periods."""
        tolerance = list(RIGS[self.truth.rig].tolerance)
        slope = self.jacobian[:, tolerance.index("actuator_gain")]
        per_unit = slope @ slope / RIGS[self.truth.rig].tolerance["actuator_gain"] ** 2 / self.periods
        steps = change * (np.arange(self.periods) - (self.periods - 1) / 2) / (self.periods + 1)
        freedom = self.baseline.size * (self.periods - 1)
        return float(np.sqrt(per_unit * (steps @ steps) / critical(freedom)))

    def tone_size(self, amplitude: float, frequency: float, at_force: bool) -> float:
        """Size of one line in the full record: amplitude in m at the probe, or in N on the rotor; frequency in Hz."""
        samples = self.periods * self.recordings[0][1].force.size
        variance = 4 * RIGS[self.truth.rig].noise["displacement"] ** 2 / samples
        loop = linear_loop(self.truth, self.recordings[0][0], np.array([frequency]))
        ratio = self.truth.parameters["probe_gain"] / self.truth.parameters["probe_nominal"]
        shown = amplitude * (abs(loop.compliance[0]) / ratio if at_force else 1.0)  # the loop changes both equally
        count = len(self.recordings)
        return float(np.sqrt(2 * count * shown**2 / variance / critical(2 * count)))
