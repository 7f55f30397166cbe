"""Channels that stand in for missing ones: an acceleration for the displacement, a coil's voltage for its current."""

from collections.abc import Collection, Mapping

import numpy as np
import scipy

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, axis_rig

SLOWEST = 4.0  # periods in a record: slower motion than this cannot be told from the drift of an accelerometer
# Bands of lines, share of them that are taken for noise alone, and times its power from which one stands out.
BANDS, QUIET, CLEAR = 60, 0.1, 10.0
ALIKE = 0.1  # of L / R: an amplifier whose time constant is within that is the coil itself under a voltage
START = 5.0  # time constants of a coil whose voltage tells what flowed at the start


def displacements(channels: Mapping[str, np.ndarray], rate: float) -> tuple[dict[str, np.ndarray], list[str]]:
    """Displacements that follow from accelerations where none is recorded, and what was assumed.

    Args:
        channels: name -> (samples,), SI.
        rate: Hz.
    """
    found, notes = {}, []
    for name, values in channels.items():
        kind, mark, axis = name.partition("_")
        displacement = f"displacement{mark}{axis}"
        if kind == "acceleration" and displacement not in channels:
            found[displacement], slowest = integrated_twice(values, rate)
            notes.append(f"{displacement} is the acceleration integrated twice, from {slowest:.3g} Hz on")
    return found, notes


def integrated_twice(acceleration: np.ndarray, rate: float) -> tuple[np.ndarray, float]:
    """Displacement of an acceleration (m/s2), without what is too slow to be told from the accelerometer's drift.

    That is what is slower than SLOWEST periods in the record. Noise is integrated, too, and grows with the fourth power
    of a falling frequency: where what lies below the first line that stands out of it would be most of the motion, that
    is left out as well.

    Args:
        acceleration: (samples,).
        rate: Hz.

    Returns:
        Displacement (samples,), and the lowest frequency in it, Hz.
    """
    n = acceleration.size
    spectrum = np.asarray(scipy.fft.rfft(acceleration - acceleration.mean()))
    line = np.arange(spectrum.size)
    first = _first_clear(abs(spectrum) ** 2, int(SLOWEST))
    kept = line >= first
    spectrum[kept] /= -((2 * np.pi * line[kept] * rate / n) ** 2)
    spectrum[~kept] = 0.0
    return np.asarray(scipy.fft.irfft(spectrum, n)), first * rate / n


def _first_clear(power: np.ndarray, slowest: int) -> int:
    """The first line from `slowest` on that stands out of the noise in the power (lines,) of an acceleration; `slowest`
    itself unless most of the displacement would lie below the other."""
    edges = np.unique(np.geomspace(slowest, max(power.size, slowest + 1), BANDS).astype(int))
    if edges.size < 2:
        return slowest
    means = np.add.reduceat(power[: edges[-1]], edges[:-1]) / np.diff(edges)
    clear = np.flatnonzero(means > CLEAR * np.quantile(means, QUIET))
    if not clear.size:
        return slowest
    first = int(edges[clear[0]])
    moved = power[slowest:] / np.arange(slowest, power.size) ** 4.0
    return first if moved[: first - slowest].sum() > moved[first - slowest :].sum() else slowest


def coil_current(voltage: np.ndarray, rate: float, resistance: float, inductance: float) -> np.ndarray:
    """Current (samples,) of a coil under a voltage held between samples.

    What flowed at the start is not known. The median of the voltage over the time constants that follow is taken to
    have held it: the first sample alone may be the kick of a step.
    """
    decay = np.exp(-resistance / inductance / rate)
    steady = voltage / resistance
    first = np.median(steady[: max(1, round(START * inductance / resistance * rate))])
    before = np.concatenate([[first], steady[:-1]])
    return scipy.signal.lfilter([1 - decay], [1.0, -decay], before, zi=[decay * first])[0]


def tells_current(rig: Rig) -> bool:
    """Whether a rig knows its coil so well that the voltage there tells the current."""
    return rig.controlled and rig.coil_resistance > 0 and rig.coil_inductance is not None


def under_voltage(rig: Rig) -> bool:
    """Whether the amplifier that a rig states is its coil under a voltage: its time constant is the coil's."""
    apart = rig.amplifier_time_constant * rig.coil_resistance / (rig.coil_inductance or np.inf) - 1
    return bool(abs(apart) <= ALIKE)


def induced_left_out(rig: Rig | None, channels: Collection[str], simulated: bool = False) -> list[str]:
    """A note where a command is a voltage over the coil's resistance, by the rig, and no current shows what is induced.

    The amplifier that such a rig states is the coil under that voltage. What a moving rotor induces in the coil is in
    neither of them, and looks like damping.

    Args:
        rig: Of the campaign; None: it names none.
        channels: Names of what is recorded.
        simulated: Whether the loop is simulated under its stated controller, which leaves a recorded current unused.
    """
    kinds = {name.partition("_")[0] for name in channels}
    if rig is None or not rig.controlled or "command" not in kinds or ("current" in kinds and not simulated):
        return []
    own = axis_rig(rig, 0)
    if not under_voltage(own):
        return []
    damping = linearise(force_law(own))[0] ** 2 / own.coil_resistance
    return [
        "the command is taken as a voltage over coil_resistance, because amplifier_time_constant is that of the coil "
        "(coil_inductance / coil_resistance): what the motion of the rotor induces in the coil is left out, and looks "
        f"like up to {damping:.2g} N s/m of damping (actuator gain squared / coil_resistance) and another stiffness; "
        "where this voltage was measured, name the channel voltage instead of command, which takes it into account"
    ]
