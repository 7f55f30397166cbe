"""Defaults of what a rig's TOML may leave out before it can be simulated and swept: gains, bounds, protocol."""

from dataclasses import replace

import numpy as np

from maglev_env.design.default_gains import default_gains
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.gain_card import KD, KI, KP
from maglev_env.loop.gains import NO_CONTROLLER, Controllers, gain_values, of_axis
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig, axis_rig

TOP, LOOP_TOP = 250.0, 2000.0  # highest force line and highest injection line, where the control rate allows them, Hz
REACH = 0.05  # share of the clearance by which the excitations move the rotor; the force law is nearly linear there
_EVERY = 5  # every fifth line belongs to the injection,
SLOW = 20.0  # and up to this frequency (Hz) every second: slow loops have all of their margins there
SPACING, FEWEST = 1.0, 25  # lines are so many Hz apart; nearer by halves where fewer would lie below the highest one


def with_defaults(rig: Rig) -> Rig:
    """The rig with gains, bounds and protocol filled in where its TOML gives none.

    Gains are those of `default_gains`; bounds are those of their cards around those of x or of the only axis. The
    protocol has five periods of 1 Hz, or of less below a control rate of 125 Hz. A force excites four of five lines up
    to 250 Hz, at 45 degrees on an x-y rig; on a controlled rig an injection into the current excites every fifth line,
    below 20 Hz every second from the first, and goes on to 2 kHz. Both together move the rotor by 5 % of its clearance.

    Raises:
        ValueError: No default gains stabilise the rig, its own gains leave it unstable, or nothing holds it, so that no
            amplitude can be chosen.
    """
    if rig.gains is None:
        rig = replace(rig, gains=_gains(rig))
    own = gain_values(of_axis(rig.gains or NO_CONTROLLER, 0))
    if rig.controlled and not rig.bounds:
        span = {name: card.range(own[name]) for name, card in (("kp", KP), ("ki", KI), ("kd", KD)) if name in own}
        rig = replace(rig, bounds={name: pair for name, pair in span.items() if pair[1] > pair[0]})
    held = all(axis_rig(rig, axis).support_stiffness for axis in range(rig.axes))
    if not (rig.protocol or rig.controlled or held):
        raise ValueError(
            f"rig {rig.name}: nothing holds it, so no force is the right one; give support_stiffness or a [protocol]"
        )
    return rig if rig.protocol else replace(rig, protocol=_protocol(rig))


def _gains(rig: Rig) -> Controllers:
    if not rig.controlled:
        return NO_CONTROLLER
    if rig.axes == 1:
        return default_gains(rig)
    return default_gains(axis_rig(rig, 0)), default_gains(axis_rig(rig, 1))


def _protocol(rig: Rig) -> Protocol:
    highest, apart = min(TOP, 0.2 * rig.control_rate), _spacing(rig.control_rate)
    top = int(highest / apart)
    lines = np.arange(1, top + 1)
    free = np.where(lines * apart < SLOW, lines % 2 == 1, lines % _EVERY == 0) & rig.controlled
    turned = 45.0 if rig.axes == 2 else 0.0
    parts = [Excitation("sphs", "force", apart, tuple(map(int, lines[~free])), direction=turned)]
    if rig.controlled:
        beyond = np.geomspace(top, min(LOOP_TOP, 0.4 * rig.control_rate) / apart, 41)[1:]
        injected = np.unique(np.concatenate([lines[free], np.round(beyond)])).astype(int)
        for axis in range(rig.axes):  # x and y take alternate lines, so that the loop of each axis is seen separately
            own = tuple(map(int, injected[axis :: rig.axes]))
            parts.append(Excitation("sphs", "current", apart, own, direction=90.0 * axis))
    share = REACH * rig.clearance / len(parts)
    protocol = Protocol(tuple(replace(part, amplitude=share / _reach(rig, part)) for part in parts))
    nearer = 2.0 ** round(np.log2(apart / SPACING))  # bands hold as many lines, whatever lies between them
    return replace(protocol, band_width=nearer * protocol.band_width, band_overlap=nearer * protocol.band_overlap)


def _spacing(control_rate: float) -> float:
    """Distance between lines, Hz: near SPACING, or a binary fraction of it; a period is a whole number of samples."""
    apart = SPACING
    while min(TOP, 0.2 * control_rate) / apart < FEWEST:
        apart /= 2
    return control_rate / round(control_rate / apart)


def _reach(rig: Rig, part: Excitation) -> float:
    """Largest reading (m) per unit of the excitation on the linearised rig."""
    e = Experiment(rig, rig.gains or NO_CONTROLLER, (part,))
    if rig.controlled and np.abs(closed_loop_poles(e)).max() >= 1:
        raise ValueError(f"rig {rig.name}: its [gains] leave it unstable; correct them, or give a [protocol]")
    lines, axes = np.array(part.lines), rig.axes
    response = loop_response(e, part.frequencies)
    per_drive = (
        response.receptance
        if part.at == "force"
        else _matrix(response.plant, axes) @ _matrix(response.sensitivity, axes)
    )
    drive = np.fft.rfft(np.atleast_2d(e.waveform(part.at)), axis=-1)[:, lines]
    moved = np.zeros((axes, e.samples_per_period // 2 + 1), complex)
    moved[:, lines] = np.einsum("nij,jn->in", _matrix(per_drive, axes), drive)
    return float(np.abs(np.fft.irfft(moved, e.samples_per_period)).max())


def _matrix(response: np.ndarray, axes: int) -> np.ndarray:
    return response.reshape(-1, axes, axes)
