"""The actuator's gain over frequency: how much force a measured current makes, and how late, band by band.

One gain for all frequencies is what the pooled estimate fits. Here a complex factor kappa on it is free in every band
of the recordings without a period. With the simulation (Y_s, I_s) of the identified rig under what drove a recording,

    e = (Y - Y_s) - P (I - I_s),    x = Y_s + P (I - I_s),    e = (kappa - 1) x + n,

where P is the linear response of displacement to current of the identified rig, and n the sensor's noise. The response
shape comes from the simulation: x is what the simulated rig would have done under the measured current. Y_s stands as
the instrument for x, which contains fed-back noise (Soderstrom and Stoica, Instrumental Variable Methods, 1983). All
are coordinates of windows of lines (`open_record`), so transients and drift are projected out. Mass, stiffness and
damping are taken as known: what they are wrong by reads as a gain that changes with frequency.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.apparent_gain import ApparentGain, BandGain, edges, tells
from estimation.lines.line_windows import WIDTH
from sim2real.compared.point import Point
from sim2real.compared.problem import Part, Problem
from sim2real.compared.simulated import experiment_near
from sim2real.judgement.nonstationary import whiteness
from sim2real.recorded.nominal import nominal_blocks
from sim2real.recorded.open_evidence import measured_series, simulated_series
from sim2real.recorded.open_record import OpenRecord

LARGEST = 3.0  # times the identified gain, that a band may show


@dataclass(frozen=True)
class Mechanics:
    """What is taken as known of the rig without control.

    Attributes:
        mass: kg.
        mass_share: Its relative standard error, by which gain and stiffness at rest grow together.
        stiffness, stiffness_se: N/m.
        damping, damping_se: N s/m.
        source: Where the stiffness is from.
    """

    mass: float
    mass_share: float
    stiffness: float
    stiffness_se: float
    damping: float
    damping_se: float
    source: str


@dataclass(frozen=True)
class _Evidence:
    """A recording's coordinates (n,) of e, x and its instrument, their noise, and its nuisances (r, n)."""

    name: str
    part: Part
    frequency: np.ndarray
    e: np.ndarray
    x: np.ndarray
    instrument: np.ndarray
    noise: np.ndarray
    nuisances: np.ndarray


def apparent_gain(problem: Problem, point: Point, gain: float, known: Mechanics) -> ApparentGain | None:
    """The gain over frequency of one-axis recordings without a period whose current was measured.

    Args:
        problem: With the noise that a good simulation leaves.
        point: The identified rig.
        gain: Its actuator gain, N/A.
        known: Its mass, stiffness and damping.

    Returns:
        The bands that tell a gain; None without such a recording, or where the identified rig touches down.
    """
    found = [_evidence(problem, i, point) for i, part in enumerate(problem.parts) if _measured(part)]
    told = [one for one in found if one is not None]
    if not told:
        return None
    lines = min((one.part.record.windows.frequency for one in told), key=lambda f: f[0, -1])
    top = max(one.frequency.max() for one in told)
    bands = [_band(*ends, told, gain, known) for ends in edges(lines[0, 0], top, lines[0, -1])]
    kept = tuple(b for b in bands if b is not None)
    return ApparentGain(kept, known.stiffness, known.stiffness_se, known.source, known.damping) if kept else None


def _measured(part: Part) -> bool:
    """Whether the current of a recording is known, and its loop has one axis."""
    record = part.record
    if not isinstance(record, OpenRecord) or record.axes != 1 or not record.experiment.rig.controlled:
        return False
    return record.source == "current" or "current" in record.series


def _evidence(problem: Problem, index: int, point: Point) -> _Evidence | None:
    part = problem.parts[index]
    record = part.record
    simulated = simulated_series(record, part.predictor.lanes([point]))[0]
    if not np.isfinite(simulated).all():
        return None
    e = experiment_near(record, point)
    _, amplifier, plant, receptance, *_ = nominal_blocks(e, record.windows.frequency.ravel(), True)
    current = 2 if record.source == "current" else 1  # the command of a simulation without an amplifier, or the current
    shape = (record.windows.count, WIDTH)
    through = (plant if current == 2 else plant / amplifier).reshape(shape)
    measured = measured_series(record)
    y, u = (record.spectrum(measured[k, 0]) for k in (0, current))
    y_s, u_s = (record.spectrum(simulated[k, 0]) for k in (0, current))
    pushed = receptance.reshape(shape) * record.spectrum(record.waves["force"][0, :: record.every])
    off = record.windows.project(y - y_s - through * (u - u_s)).ravel()
    if record.bias is not None:
        off = off - record.bias[0]
    x = record.windows.project(y_s + through * (u - u_s) - pushed).ravel()
    used, at = part.used, part.opened.outputs.index("plant")
    count = int(used.sum())
    own = slice(part.place.start + at * count, part.place.start + (at + 1) * count)
    noise = part.noise[at, 0]
    return _Evidence(
        record.name,
        part,
        record.frequency[used],
        off[used],
        x[used],
        record.windows.project(y_s - pushed).ravel()[used],
        noise[used],
        problem.nuisances.columns[:, own] * noise[used] / np.sqrt(2),
    )


def _band(
    low: float,
    high: float,
    found: Sequence[_Evidence],
    gain: float,
    known: Mechanics,
) -> BandGain | None:
    names, factors, variances, shifts, centres = [], [], [], [], []
    for one in found:
        on = (one.frequency >= low) & (one.frequency < high)
        if not on.any():
            continue
        weighted = np.conj(one.instrument) / one.noise**2 * on
        toward = weighted / np.sum(weighted * one.x)  # what each coordinate adds to the factor
        off = np.sum(toward * one.e)
        left = (one.e - off * one.x) * np.sqrt(2) / one.noise
        white = toward * one.noise / np.sqrt(2)
        factors.append(1 + off)
        variances.append(np.sum(abs(white) ** 2) * _coherent(one, white, left))
        shifts.append(one.nuisances @ toward)
        power = abs(one.instrument / one.noise) ** 2 * on
        centres.append(np.sum(power * one.frequency) / np.sum(power))
        names.append(one.name)
    if not names:
        return None
    variance, each = np.array(variances), np.array(factors)
    weight = variance**-1 / np.sum(variance**-1)
    factor = complex(weight @ each)
    scatter = np.sum(abs(each - factor) ** 2 / variance) / max(2 * (each.size - 1), 1)  # Birge's ratio, squared
    noise = max(scatter, 1.0) / np.sum(variance**-1)
    centre = float(weight @ np.array(centres))
    w = 2 * np.pi * centre
    dynamic = known.stiffness - known.mass * w**2 + 1j * w * known.damping
    wrong = [known.stiffness_se / dynamic, 1j * w * known.damping_se / dynamic, known.mass_share]
    # Relative to the factor: real parts change its size, imaginary ones its angle.
    common = np.append(weight @ np.array(shifts) / factor, wrong)
    relative = noise / abs(factor) ** 2
    size, phase = relative + np.sum(common.real**2), relative + np.sum(common.imag**2)
    # No iron or coil makes the gain grow so: what is seen there is no force of the current.
    if not tells(noise, factor, common.real) or abs(factor) > LARGEST:
        return None
    sure = [tells(own, one, np.zeros(0)) for own, one in zip(variance, each, strict=True)]
    own = {name: complex(gain * value) for name, value, tells in zip(names, each, sure, strict=True) if tells}
    total, sign = complex(gain * factor), float(np.sign(gain))
    return BandGain(
        float(low), float(high), centre, total, float(np.sqrt(size)) * abs(total), float(np.sqrt(phase)), own, sign
    )


def _coherent(one: _Evidence, white: np.ndarray, left: np.ndarray) -> float:
    """Factor on the variance by errors at single moments; the larger one of real and imaginary part."""
    at, outputs = one.part.opened.outputs.index("plant"), len(one.part.opened.outputs)
    size = left.size

    def placed(values: np.ndarray) -> np.ndarray:
        whole = np.zeros((*values.shape[:-1], outputs * size), complex)
        whole[..., at * size : (at + 1) * size] = values
        return whole

    toward = placed(np.stack([np.conj(white), 1j * np.conj(white)]))
    return float(whiteness([one.part], toward, placed(left), [slice(0, outputs * size)]).max())
