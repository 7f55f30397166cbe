"""A stand-in controller that answers to the motion which the simulated rig makes of the recorded drive.

Under a stand-in C', the simulated reading is S (P u + P C' y') with the recorded drive u and the reading y' that the
stand-in is given, and S = 1 / (1 + P C'). What is compared does not depend on y', but its derivative does: by a change
of P it is S dP (u + C' S (y' - P u)). Where y' is the recorded reading, y' - P u is its noise, and the same noise is
what the fit is to leave. A fit then makes the noise smaller by moving what moves S, as a likelihood without its
determinant does: not much of what is told well, but several standard errors of a damping or a delay that is not. So in
the lines that are compared y' is P u, by the rig about which the comparison is linearised.
"""

from dataclasses import replace

import numpy as np
import scipy.fft
from scipy.interpolate import CubicSpline

from estimation.lines.line_windows import KEPT
from maglev_env.loop.gains import controller_output, of_axis
from sim2real.recorded.open_record import OpenRecord


def anchored(record: OpenRecord, residual: np.ndarray) -> OpenRecord:
    """The record with a stand-in that is not given the residual of what is compared.

    Args:
        record: compared along instruments, under a stand-in controller.
        residual: opened spectra (axes, windows, WIDTH) of what the stand-in is given, less the simulated reading.
    """
    w, e = record.windows, record.experiment
    told = record.excited.reshape(w.count, KEPT).any(axis=1)
    lines = w.cleared(residual) * told[:, None]
    spectrum = np.zeros((record.axes, w.samples // 2 + 1), complex)
    spectrum[:, w.first : w.first + w.count * lines.shape[-1]] = lines.reshape(record.axes, -1) * (w.samples / 2)
    own = np.asarray(scipy.fft.irfft(spectrum, w.samples, axis=-1))
    samples = record.series["displacement"].shape[1]
    # It is periodic over what is compared. Before that, the simulation is led into it.
    change = own[:, (np.arange(samples) - record.first) % w.samples]
    change[:, : record.first] *= 0.5 - 0.5 * np.cos(np.pi * np.arange(record.first) / max(record.first, 1))
    ticks = np.arange(samples * record.every) / record.every
    between = change if record.every == 1 else CubicSpline(np.arange(samples), change, axis=1)(ticks)
    answer = np.array([
        controller_output(of_axis(e.gains, axis), series, 1 / e.rig.control_rate)
        for axis, series in enumerate(between)
    ])  # fmt: skip
    waves = {**record.waves, "current": record.waves["current"] + answer}
    return replace(record, waves=waves, added=record.added + answer[:, :: record.every])
