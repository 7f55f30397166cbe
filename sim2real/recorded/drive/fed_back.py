"""Sensor noise that the unknown true controller has fed back into what drives a simulation.

Let y = P u + n with the measured current u, of which the controller has made -C S n from the noise n. Under a stand-in
C', the simulated current is u_s = u + C'S' (y - P u), with the noise (C'S' - C S) n. It is correlated with the residual
n, which biases a fit where the noise is not small (as in identification by the direct method: Ljung, System
Identification, 1999, section 13.4). C is estimated from the record by a long regression; the bias that it predicts,
b = conj(C'S' - C S) |n|^2 / |u_s|^2 u_s, is taken off, and a share of it remains as a nuisance. Of a window in which
the drive moves the rotor little more than the noise does, nothing is used.
"""

from dataclasses import replace

import numpy as np
import scipy.fft

from estimation.lines.line_windows import KEPT, NOISE_ALONE, POOLED
from maglev_env.recordings.left_out import TellsNothing
from sim2real.recorded.nominal import nominal_blocks
from sim2real.recorded.open_record import OpenRecord

CLEAR = 4.0  # power of the motion that u_s causes, over that of the noise, from which a window is used
UNSURE = 0.3  # share of the predicted bias that remains as a standard deviation
TAPS = 24  # past outputs and readings of the regression
MOST_ROWS = 20_000  # of the regression


def fed_back(record: OpenRecord, driving: np.ndarray, between: np.ndarray) -> OpenRecord:
    """The record with the windows that tell something, and with the bias that fed-back noise may cause.

    Args:
        record: driven by a measured current or command, under a stand-in controller.
        driving: (axes, samples), that current or command over the simulated part.
        between: (windows, WIDTH), what the drive between the samples is to the spectrum of the samples.

    Raises:
        TellsNothing: nowhere does the drive move the rotor clearly more than the noise does.
    """
    blocks = nominal_blocks(record.experiment, record.windows.frequency.ravel(), False)
    controller, _, plant, *_ = (np.reshape(b, (record.axes, *record.windows.frequency.shape)) for b in blocks)
    u = between * record.spectrum(driving)
    readings = record.series["displacement"]
    back = controller / (1 + controller * plant)
    simulated = u + back * (record.spectrum(readings) - plant * u)
    power = np.mean(abs(simulated) ** 2, axis=-1)
    y = readings[:, record.first :]
    samples = y.shape[1]
    lines = slice(*(int(share * samples) for share in NOISE_ALONE))
    floor = np.mean(
        abs(np.asarray(scipy.fft.rfft(y - y.mean(axis=1, keepdims=True)))[:, lines] * (2 / samples)) ** 2, 1
    )
    moved = np.mean(abs(plant * simulated) ** 2, axis=-1)
    told = _together((moved > CLEAR * floor[:, None]).any(axis=0))
    left = np.mean(abs(record.spectrum(readings) - plant * u) ** 2, axis=-1)
    told &= (moved > CLEAR * left).any()  # else the drive is what a controller made of noise or of a force
    if not told.any():
        raise TellsNothing(
            "what is recorded of the drive moves the rotor no more than the noise does",
            "record larger steps, or the command with the gains of the controller",
        )
    z = np.exp(2j * np.pi * record.windows.frequency / record.windows.sample_rate)
    true = np.array([_regressed(c, x, z) for c, x in zip(driving, readings, strict=True)])
    true = between * true / (1 + between * true * plant)
    bias = floor[:, None, None] * np.conj(back - true) / np.maximum(power, 1e-300)[..., None] * simulated
    found = record.windows.project(bias)
    found = found.reshape(*found.shape[:-2], -1)
    return replace(
        record, told=np.repeat(told, KEPT), bias=found, unsure={f"noise in the drive of {record.name}": UNSURE * found}
    )


def _together(told: np.ndarray) -> np.ndarray:
    """The windows (windows,) that tell something, up to the first gap of POOLED windows after them."""
    begun = np.cumsum(told) > 0
    silent = begun & (np.convolve(told, np.ones(POOLED), "full")[: told.size] == 0)
    return told & (np.cumsum(silent) == 0)


def _regressed(command: np.ndarray, displacement: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Response of the controller at points z of the unit circle, by a regression long enough to whiten what drives it.

    Args:
        command: (samples,), A.
        displacement: (samples,), m.
        z: any shape.
    """
    taps = min(TAPS, command.size // 20)
    n = min(command.size - taps, MOST_ROWS)
    past = [np.stack([s[taps - k : taps - k + n] for k in range(first, taps + 1)], axis=1)
            for s, first in ((command - command.mean(), 1), (displacement.mean() - displacement, 0))]  # fmt: skip
    columns = np.concatenate(past, axis=1)
    scale = np.maximum(abs(columns).max(axis=0), 1e-300)
    found = np.linalg.lstsq(columns / scale, command[taps : taps + n] - command.mean(), rcond=1e-10)[0] / scale
    powers = z[..., None] ** -np.arange(taps + 1)
    return (powers @ found[taps:]) / (1 - powers[..., 1:] @ found[:taps])
