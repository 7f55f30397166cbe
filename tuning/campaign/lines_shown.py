"""What the lines of one recording show of the loop: its responses, and the sizes of its signals."""

import numpy as np

from estimation.lines.frequency_response import frequency_response, pooled_variance
from estimation.lines.periods import LineStatistics
from maglev_env.loop.gains import PidGains, controller_response
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.spectra import RecordedSignals, record_spectra
from maglev_env.rig.rig import Rig
from tuning.campaign.gain_set import GainSet, Response

LEAST_LINES = 4  # that a curve of margins needs


def identified(signals: RecordedSignals, rig: Rig, gains: PidGains, file: str) -> GainSet:
    """What the lines of a recording show.

    Raises:
        TellsNothing: They show nothing of the loop.
        ValueError: What is stated of the recording or the rig is wrong.
    """
    try:
        spectra = record_spectra(signals)
    except ValueError as error:
        raise TellsNothing(str(error), "record what is stated of its excitation, over more periods") from error
    receptance = sensitivity = plant = None
    if spectra.driven["force"].size >= LEAST_LINES and "force" in spectra.force.channels:
        receptance = _response(spectra.force, "displacement", "force")
    injected = spectra.all.at_lines(spectra.driven["current"])
    if injected.lines.size >= LEAST_LINES:
        if "command" in injected.channels:
            sensitivity = _response(injected, "command", "injection")
            plant = _response(injected, "displacement", "command")
        else:  # the controller is known: command = injection - controller * displacement
            moved = _response(injected, "displacement", "injection")
            z = np.exp(2j * np.pi * moved.frequency / rig.control_rate)
            c = controller_response(gains, z, 1 / rig.control_rate)
            s = 1 - c * moved.value
            sensitivity = Response(moved.frequency, s, np.abs(c) ** 2 * moved.variance)
            plant = Response(moved.frequency, moved.value / s, moved.variance / np.abs(s) ** 4)
    if receptance is None and plant is None:
        raise TellsNothing(
            "it shows nothing of the loop",
            f"excite {LEAST_LINES} lines or more at the force (with the channel force) or at the current, best both as "
            "the rig's [protocol] does",
        )
    kept = slice(spectra.transient_periods * per_period(signals) if signals.periodic else 0, None)
    current = signals.channels.get("current", signals.channels.get("command", np.full(1, np.nan)))
    noise, error = _noise_current(signals, rig, spectra.transient_periods)
    return GainSet(
        gains, (file,), receptance, sensitivity, plant, (spectra.force,) if receptance else (),
        float(np.abs(signals.channels["displacement"][kept]).max()), float(np.sqrt(np.mean(current[kept] ** 2))), None,
        noise_current=noise, noise_error=error,
    )  # fmt: skip


def _noise_current(signals: RecordedSignals, rig: Rig, transient: int) -> tuple[float, float]:
    """Rms of what does not repeat of the coil's current, less the noise of its reading, and its relative error.

    nan where nothing is left. Where the reading has far more noise than the current, what is left is a small difference
    of large powers. The first periods, as many as are transient and at least one, and masked ones do not count.
    """
    if not signals.periodic or "current" not in signals.channels:
        return np.nan, 0.0
    n, current = per_period(signals), signals.channels["current"]
    periods = np.delete(current[: current.size // n * n].reshape(-1, n), signals.left_out, axis=0)[max(transient, 1) :]
    if len(periods) < 2:
        return np.nan, 0.0
    power = float((periods - periods.mean(axis=0)).var() * len(periods) / (len(periods) - 1))
    left = power - rig.noise.current**2
    if left <= 0:
        return np.nan, 0.0
    return float(np.sqrt(left)), power / left / np.sqrt(2 * n * (len(periods) - 1))


def _response(statistics: LineStatistics, output: str, source: str) -> Response:
    value, variance = frequency_response(statistics, output, source)
    return Response(statistics.frequency, value, pooled_variance(variance))


def per_period(signals: RecordedSignals) -> int:
    """Samples in what repeats of a recording: a period, or the block of periods that holds whole samples."""
    return next(e for e in signals.excitations if e.periodic).block(signals.sample_rate)[0]
