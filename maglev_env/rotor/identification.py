"""Stiffness, damping and sensitivity of a levitated rotor at any speed, from currents injected at its controllers.

The injection rotates forward. In isotropic bearings the complex displacement x + i y then responds at that frequency
alone, and (k - M w^2 + I_p speed w + i w c) Q = F keeps each mode a single degree of freedom while the rotor spins. The
lines lie half-way between multiples of twice the fundamental, where a speed of such a multiple has no harmonics; at
other speeds the unbalance would be read as an answer to the injection.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import scipy

from estimation.max_likelihood import maximum_likelihood
from estimation.lines.periods import LineStatistics, line_statistics
from estimation.multisine.sphs import sphs, synthesise
from estimation.stability_margins import peak_sensitivity
from maglev_env.loop.gains import controller_response
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import control_matrices, held_current, mechanics, reading_response, rejection_response
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.run_up import waiting
from maglev_env.rotor.simulate import Spun, alike, reduced, shared_rate

MODES = ("translation", "tilt")
UNITS = {"translation": ("N/m", "N s/m"), "tilt": ("N m/rad", "N m s/rad")}
TOP = 2000.0  # highest line, Hz; the loop's crossings lie below it
OF_RATE = 0.4  # of the control rate, which the highest line stays below
DENSITY = 26  # lines per controller, with a constant ratio between neighbours
NOT_CLEAR = 1e-6  # of `Protocol.clear`: of speeds that are nearer to a multiple, rounding is left


def period_samples(rotor: Rotor, fundamental: float) -> int:
    """Control samples per period.

    Raises:
        ValueError: The number is not whole.
    """
    n = rotor.axis.control_rate / fundamental
    if abs(n - round(n)) > 1e-9 * n:
        raise ValueError(f"fundamental = {fundamental} Hz: a period of {n:g} control samples is not whole")
    return round(n)


def turning(wave: np.ndarray) -> np.ndarray:
    """A periodic wave (n,) in x and the wave in y that makes all its lines rotate forward, (2, n)."""
    return np.array([wave, np.fft.irfft(-1j * np.fft.rfft(wave), len(wave))])


def forward(rows: np.ndarray) -> np.ndarray:
    """The forward-rotating part of complex amplitudes (..., 2 n, lines) in x and y, (..., n, lines)."""
    return (rows[..., ::2, :] + 1j * rows[..., 1::2, :]) / 2


def motion(rotor: Rotor, seen: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Motion of the centre of mass and tilt (..., 2, lines), m and rad, with the lag of probe or estimator removed.

    Args:
        rotor: The rotor.
        seen: Forward amplitudes of the readings at a and b, (..., 2, lines).
        frequency: (lines,), Hz.
    """
    return np.linalg.inv(mechanics(rotor).probes[::2, :2]) @ (seen / reading_response(rotor, frequency))


@dataclass(frozen=True)
class Protocol:
    """The identification experiment.

    Attributes:
        fundamental: Hz; the lines are odd multiples of it. A rotor's own is that of whole control samples; see `of`.
        amplitude: Peak of the injection at each controller, A.
        settle: Periods to settle, beside those of a force rejection.
        periods: Periods that are kept.
        band: Band in which coefficients are estimated, Hz.
        top: Highest line, Hz.
    """

    fundamental: float = 25 / 6
    amplitude: float = 0.05
    settle: int = 2
    periods: int = 4
    band: tuple[float, float] = (60.0, 180.0)
    top: float = TOP

    def of(self, control_rate: float) -> "Protocol":
        """The protocol at a control rate (Hz): periods have whole samples, and no line lies beyond OF_RATE of it."""
        samples = round(control_rate / self.fundamental)
        return replace(self, fundamental=control_rate / samples, top=min(self.top, OF_RATE * control_rate))

    @property
    def clear(self) -> float:
        """Speed (rpm) no harmonic of a multiple of which falls on a line: twice the fundamental."""
        return 120 * self.fundamental

    def clear_speed(self, speed_rpm: float) -> float:
        """The next clear speed (rpm) at a speed or between it and standstill."""
        return round(int(speed_rpm / self.clear * (1 + 1e-12)) * self.clear, 6)

    def check_clear(self, speed_rpm: float) -> None:
        """Raise ValueError unless a speed (rpm) is clear of the lines."""
        turns = speed_rpm / self.clear
        if abs(turns - round(turns)) > NOT_CLEAR:
            raise ValueError(
                f"identification at {speed_rpm:g} rpm: harmonics of the rotation fall between and onto the injected "
                f"lines; give a multiple of {self.clear:.10g} rpm, e.g. {self.clear_speed(speed_rpm):.10g}"
            )

    def settling(self, rotor: Rotor) -> int:
        """Periods to settle, with those in which the rotor's force rejection finds the unbalance."""
        return self.settle + ceil(waiting(rotor) * self.fundamental)

    def samples(self, rotor: Rotor) -> int:
        """Control samples per period.

        Raises:
            ValueError: The number is not whole.
        """
        return period_samples(rotor, self.fundamental)

    @property
    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Harmonics injected at the first and the second controller: thinned out from 1, 5, 9 ... and 3, 7, 11 ..."""
        grid = np.geomspace(3, self.top / self.fundamental, 2 * DENSITY)
        first, second = (np.unique((np.rint((part - o) / 4) * 4 + o).astype(int)) for o, part in ((1, grid), (3, grid)))
        return first[first > 0], second[second > 0]

    def injection(self, rotor: Rotor) -> np.ndarray:
        """One period (4, samples) A of the signals added to the commands, rotating forward in x and y."""
        n, found = self.samples(rotor), []
        _, out = control_matrices(rotor)
        for lines in self.lines:
            found.append(turning(synthesise(sphs(lines, n, self.amplitude), n)))
        return out @ np.concatenate(found)


@dataclass(frozen=True)
class RotorIdentification:
    """Results of n runs for the modes MODES; nan after a touchdown.

    Attributes:
        stiffness: Of the rotor in its bearings under control, in the protocol's band, (n, 2), N/m and N m/rad.
        stiffness_se: Standard error.
        damping: (n, 2), N s/m and N m s/rad.
        damping_se: Standard error.
        peak_sensitivity: Of each controller, (n, 2).
        peak_frequency: Its frequency, Hz.
        frequency: Frequencies of the sensitivity, 2 arrays, Hz.
        sensitivity: 2 arrays (n, lines).
    """

    stiffness: np.ndarray
    stiffness_se: np.ndarray
    damping: np.ndarray
    damping_se: np.ndarray
    peak_sensitivity: np.ndarray
    peak_frequency: np.ndarray
    frequency: tuple[np.ndarray, np.ndarray]
    sensitivity: tuple[np.ndarray, np.ndarray]


def identify_runs(
    runs: Sequence[Run], protocol: Protocol = Protocol(), threads: int | None = None
) -> RotorIdentification:
    """Inject, record and estimate each run separately; a run's result does not depend on the others.

    Args:
        runs: The runs; they share the control rate and what their controllers act on.
        protocol: The identification experiment, of which `Protocol.of` the control rate is done.
        threads: Number of threads; results do not depend on it.

    Raises:
        ValueError: Control rates differ, or a speed is not clear of the lines.
    """
    protocol = protocol.of(shared_rate([run.rotor for run in runs]))
    for run in runs:
        protocol.check_clear(run.speed_rpm)
    found: list[tuple] = [()] * len(runs)
    # Currents that push a rotor without turning it are others where the planes are others.
    for some in alike([(protocol.settling(r.rotor), control_matrices(r.rotor)[1].tobytes()) for r in runs]):
        for i, one in zip(some, _identified([runs[i] for i in some], protocol, threads), strict=True):
            found[i] = one
    columns = [np.array([f[i] for f in found]) for i in range(6)]
    frequency = tuple(lines * protocol.fundamental for lines in protocol.lines)
    return RotorIdentification(*columns, frequency, tuple(np.array([f[6][c] for f in found]) for c in range(2)))


def _identified(runs: Sequence[Run], protocol: Protocol, threads: int | None) -> list[tuple]:
    """As `_of_run`, of runs that settle for the same time and whose controllers drive their planes in the same way."""
    rotor = runs[0].rotor
    n, waves = protocol.samples(rotor), protocol.injection(rotor)
    settle = protocol.settling(rotor) * n
    measured = reduced(runs, protocol.periods * n, lambda spun, _: _spectra(spun, n), settle, waves, threads=threads)
    spectra = np.concatenate(list(measured))  # (n, periods, 4, lines)
    drive = np.fft.rfft(waves, axis=-1) * (2 / n)
    return [_of_run(run, one, drive, protocol, n) for run, one in zip(runs, spectra, strict=True)]


def _spectra(spun: Spun, n: int) -> np.ndarray:
    """Complex amplitudes of the readings in each period, (runs, periods, 4, n // 2 + 1); nan after a touchdown."""
    read = spun.readings
    found = scipy.fft.rfft(read.reshape(*read.shape[:2], -1, n), axis=-1) * (2 / n)
    found[np.isfinite(spun.first_contact).any(axis=1)] = np.nan
    return found.transpose(0, 2, 1, 3)


def _of_run(run: Run, spectra: np.ndarray, drive: np.ndarray, protocol: Protocol, n: int) -> tuple:
    """Stiffness, its error, damping, its error, peak and its frequency (2 each), and the sensitivities."""
    if np.isnan(spectra).any():
        nothing = np.full(2, np.nan)
        return (nothing,) * 6 + ([np.full(lines.size, np.nan, complex) for lines in protocol.lines],)
    rotor, dt = run.rotor, 1 / run.rotor.axis.control_rate
    into, out = (matrix[::2, ::2] for matrix in control_matrices(rotor))
    every = np.union1d(*protocol.lines)
    w = 2 * np.pi * every * protocol.fundamental
    seen, currents = forward(spectra[..., every]), forward(drive[:, every])  # (periods, 2 planes, lines), (2, lines)
    peaks, shapes = [], []
    for c, (gains, lines) in enumerate(zip(rotor.gains.values(), protocol.lines, strict=True)):
        at = np.searchsorted(every, lines)
        z = np.exp(1j * w[at] * dt)
        put_in = (np.linalg.inv(out) @ currents)[c, at]
        ahead = (into @ seen.mean(axis=0))[:, at].T[..., None]
        answer = (rejection_response(rotor, every[at] * protocol.fundamental, run.speed) @ ahead)[:, c, 0]
        s = 1 - controller_response(gains, z, dt) * answer / put_in
        shapes.append(s)
        peaks.append(peak_sensitivity(w[at] / (2 * np.pi), s))
    frequency = every * protocol.fundamental
    moved = motion(rotor, seen, frequency)
    force = mechanics(rotor).drive[:2, ::2] @ currents * held_current(rotor, frequency)
    result = [_mode(run, j, moved[:, j], force[j], every, protocol) for j in range(2)]
    return (*np.array(result).T, *(np.array([p[i] for p in peaks], float) for i in range(2)), shapes)


def _mode(
    run: Run, mode: int, motion: np.ndarray, force: np.ndarray, lines: np.ndarray, protocol: Protocol
) -> tuple[float, float, float, float]:
    """Stiffness and damping of one mode in the protocol's band with standard errors, in the order k, se, c, se."""
    rotor, w = run.rotor, 2 * np.pi * lines * protocol.fundamental
    low, high = protocol.band
    driven = abs(force) > 1e-6 * abs(force).max()
    used = driven & (w >= 2 * np.pi * low) & (w <= 2 * np.pi * high)
    gyroscopic = (rotor.body.polar_inertia * run.speed if mode else 0.0) * w
    # The gyroscopic part is subtracted from the force, so that a single mass, spring and damper remains.
    pushed = np.broadcast_to(force, motion.shape) - gyroscopic * motion
    channels = np.stack([pushed, motion], axis=1)[..., used]
    statistics: LineStatistics = line_statistics(channels, protocol.fundamental, lines[used], ("force", "displacement"))
    inertia = rotor.moving_inertia if mode else rotor.moving_mass
    band = maximum_likelihood(statistics, np.array([[low, high]]), inertia, intervals=False)
    return tuple(float(v[0]) for v in (band.stiffness, band.stiffness_se, band.damping, band.damping_se))
