"""What a recorded reference, injection or force alone causes, where noise is part of what drives a simulation.

Under a stand-in controller the measured current drives the simulation, with all that the true controller made of sensor
noise, of the current meter's noise and of unknown forces. The same noise is in the reading, so a fit of all that varies
is biased. The reference is free of it, and so are an injection and the force of a hammer or a shaker. Only what goes
with them is compared: in each window of lines, current and reading are projected on them, as with an instrumental
variable (Soderstrom and Stoica, System Identification, 1989, chapter 8; for a closed loop Van den Hof, Annual Reviews
in Control 22, 1998). Nothing need be known of the controller or of the noise.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estimation.lines.line_windows import KEPT
from sim2real.recorded.open_record import OpenRecord

CLEAR = 10.0  # power along the instruments over that of the noise, from which a window is used
BESIDE = 2  # windows on either side whose power tells that of the one between them


def has_instruments(channels: Mapping[str, np.ndarray]) -> bool:
    """Whether channels -> (axes, samples) hold a reference, an injection or a force that varies."""
    return len(varying(channels, 0)) > 0


def along_instruments(record: OpenRecord, channels: Mapping[str, np.ndarray], top: float) -> OpenRecord | None:
    """The record, compared only along its instruments; None where it has none that clearly moves the rotor.

    Args:
        record: driven by a measured current or command.
        channels: channel -> (axes, samples) of the simulated part.
        top: highest frequency that is compared, Hz.
    """
    known = varying(channels, record.first)
    return compared_along(record, known, top) if len(known) else None


def compared_along(record: OpenRecord, known: np.ndarray, top: float) -> OpenRecord | None:
    """The record, compared only along instruments; None where none of them clearly moves the rotor.

    Args:
        record: driven by a measured current or command.
        known: (inputs, samples), series that are free of the reading's noise.
        top: highest frequency that is compared, Hz.
    """
    spectra = record.spectrum(known)
    windows = record.windows.toward(spectra)
    reading = record.spectrum(record.series["displacement"])
    along = np.arange(KEPT) < len(known)
    power = np.mean(abs(windows.project(reading)[..., along]) ** 2, axis=-1)
    noise = windows.noise(reading, spectra).variance
    driven = np.sum(abs(windows.project(spectra)) ** 2, axis=-1)
    driven = np.sum(driven / np.maximum(driven.sum(axis=-1, keepdims=True), 1e-300), axis=0)
    clear = (_expected(power, noise, driven) > CLEAR * noise).any(axis=0)
    clear &= windows.centre < top
    if not clear.any():
        return None
    return replace(record, windows=windows, told=(clear[:, None] & along).reshape(-1), instrument=spectra)


def _expected(power: np.ndarray, noise: np.ndarray, driven: np.ndarray) -> np.ndarray:
    """Power (axes, windows) along the instruments as the neighbours of each window let expect it.

    Windows that were chosen by their own power would be those to which noise has added.

    Args:
        power, noise: along the instruments and of the noise, (axes, windows).
        driven: power of the instruments (windows,).
    """
    beside = np.ones(2 * BESIDE + 1)

    def around(series: np.ndarray, own: np.ndarray | float) -> np.ndarray:
        padded = np.apply_along_axis(np.convolve, -1, series, beside, "same")
        return padded - np.where(own, 0.0, series)

    # What drives a narrow band has no neighbours that tell: there the own power is taken, too.
    alone = driven > around(driven, 0.0)
    gain = around(np.maximum(power - noise, 0.0), alone) / np.maximum(around(driven, alone), 1e-300)
    return gain * driven + noise


def varying(channels: Mapping[str, np.ndarray], first: int) -> np.ndarray:
    """Series (inputs, samples) of the channels that are free of noise and vary from a sample on."""
    known = [s for name in ("reference", "injection", "force") if name in channels for s in channels[name]]
    return np.array([s for s in known if np.ptp(s[first:]) > 0])
