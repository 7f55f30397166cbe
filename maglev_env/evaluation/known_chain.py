"""Line statistics of what the known parts of a rig turn readings into: the motion, the coil's current, the force."""

import numpy as np

from estimation.lines.periods import LineStatistics, held, multiplied
from maglev_env.evaluation.late_step import behind_readings, flowing_lag, sampled_lag, step_after_reading
from maglev_env.experiment import Experiment
from maglev_env.recordings.measurement_chain import lagless
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig


def rotor_motion(statistics: LineStatistics, rig: Rig | None, ending: str = "") -> LineStatistics:
    """The displacement without the lag T of the nominal probe, which would take k T off the damping.

    Args:
        statistics: with the channel "displacement".
        rig: one axis; None leaves the statistics as they are.
        ending: of the channel's name on one of two axes, such as "_x".
    """
    return _ahead(statistics, f"displacement{ending}", rig.sensor_time_constant if rig else 0.0)


def flowing(
    statistics: LineStatistics, rig: Rig | None, sample_rate: float
) -> tuple[LineStatistics, LineStatistics | None, float]:
    """The channel "current" as it flows between its readings.

    Args:
        statistics: with the channel "current".
        rig: one axis.
        sample_rate: of the readings, Hz.

    Returns:
        The statistics; the same one standard deviation of what is not known of that further, None where nothing is
        unknown; and what that is in time, s.
    """
    if (rate := unknown_between(rig, sample_rate)) is not None:
        return *between_both(statistics, rate), 12**-0.5 / rate
    if rig is None or not steps_between(rig, sample_rate):
        return statistics, None, 0.0
    lag, known = rig.amplifier_time_constant, rig.tolerance.get("amplifier_time_constant")
    late, unsure = step_after_reading(statistics, sample_rate, lag, known)
    found, moved = (between_readings(statistics, rig, sample_rate, late + more) for more in (0.0, unsure))
    begin, end = (behind_readings(lag * sample_rate, late + more) for more in (0.0, unsure))
    return found, moved, abs(end - begin) / sample_rate


def coil_current(statistics: LineStatistics, rig: Rig | None) -> LineStatistics:
    """The command, in the channel "current", behind the lag of the nominal amplifier."""
    return _ahead(statistics, "current", -rig.amplifier_time_constant if rig else 0.0)


def between_readings(
    statistics: LineStatistics, rig: Rig | None, sample_rate: float, late: float = 0.0
) -> LineStatistics:
    """The current that flows between readings at the control ticks, of which each step of the command comes behind one.

    Behind the lag T of an amplifier whose input is held, the current is a chain of exponentials. Its line differs from
    that of its readings by the images of the hold, hence by the ratio of the continuous to the sampled lag. For the
    damping that is as much as a delay of a part of the control period.

    Args:
        statistics: with the channel "current".
        rig: one axis; None, or another sample rate than its control rate, leaves the statistics as they are.
        sample_rate: of the readings, Hz.
        late: by how much of a control period the command steps after the reading; whole periods make no difference.
    """
    if not steps_between(rig, sample_rate):
        return statistics
    x, lag = statistics.frequency / sample_rate, rig.amplifier_time_constant * sample_rate
    return multiplied(statistics, "current", flowing_lag(x, lag, late) / sampled_lag(x, lag, late))


def steps_between(rig: Rig | None, sample_rate: float) -> bool:
    """Whether a current behind an amplifier of known lag is read at the control ticks, while its command steps."""
    return rig is not None and bool(rig.amplifier_time_constant) and sample_rate == rig.control_rate


def unknown_between(rig: Rig | None, sample_rate: float) -> float | None:
    """Rate (Hz) at which a current may be held between its readings, where nothing is stated of its lag; else None.

    A current that follows the command at once, and is read behind its step, is held for the control period that
    follows: it acts half a period late. Read before the step, it was held for the period before. The readings of one
    behind a long lag lie on straight lines, which act on time.

    Args:
        rig: one axis; its tolerance of 0 says that it has no lag.
        sample_rate: of the readings, Hz.
    """
    if rig is None or rig.amplifier_time_constant or lagless(rig):
        return None
    return max(sample_rate, rig.control_rate)


def between_both(statistics: LineStatistics, held_rate: float) -> tuple[LineStatistics, LineStatistics]:
    """The channel "current" as in the middle of what `unknown_between` allows, and a standard deviation from there.

    Lines of a held current are its readings' times sinc(x), half a period late or early; those of straight lines times
    sinc(x)^2; with x = frequency / rate.
    """
    x = statistics.frequency / held_rate
    middle = multiplied(statistics, "current", np.sinc(x) ** 1.5)
    return middle, multiplied(middle, "current", np.sinc(x) ** -0.5 * np.exp(-1j * np.pi * x / 3**0.5))


def force_statistics(statistics: LineStatistics, experiment: Experiment) -> LineStatistics:
    """Force and displacement at the force lines, with the converter's hold removed from the force.

    Raises:
        ValueError: No force is excited.
    """
    lines = lines_at(experiment.excitations, "force")
    if not lines.size:
        raise ValueError("experiment: stiffness and damping need an excitation at the force")
    return held(statistics.at_lines(lines, ("force", "displacement")), "force", experiment.rig.control_rate)


def _ahead(statistics: LineStatistics, channel: str, lag: float) -> LineStatistics:
    """A channel with a first-order lag taken out, or put in where it is negative."""
    response = 1 + 2j * np.pi * statistics.frequency * abs(lag)
    return multiplied(statistics, channel, response if lag >= 0 else 1 / response) if lag else statistics
