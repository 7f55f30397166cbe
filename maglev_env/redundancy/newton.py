"""Force, current and displacement against each other by Newton's law with the stated mass.

Only lines count at which the mass dominates: there the stiffness, which effects change most, hardly matters.
"""

from dataclasses import replace

import numpy as np
import scipy

from estimation.lines.line_windows import NOISE_ALONE
from estimation.lines.periods import zero_order_hold
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.redundancy.controller import at_control_rate, made_alone
from maglev_env.redundancy.rows import MODEL, Fit, Row, fit, low_pass
from maglev_env.redundancy.view import Lines, View

DOMINATES = 1.5  # m w^2 over the stiffness, from which a line counts
WIDE = 4.0  # standard deviations of the tolerances
KNOWN = {"mass": 0.01, "probe_gain": 0.03, "actuator_gain": 0.1}  # relative, where the rig states no tolerance
STIFFNESS = 0.05  # what an error of the stiffness may do at these lines
MOVES = 0.7  # m w^2 over the stiffness, from which a line tells of time without a rig
LATE = 0.8  # of a sample: how a force acts between samples is assumed without a rig
FILTERED = 6.0  # samples: the largest time constant of a filter in an unknown controller
# rad at the middle of the lines: what is turned by more beside a reversed sign may as well be another dynamics, as of a
# spring that nobody stated and that is stiffer than the magnets.
TURNED = np.pi / 4
SHAPE, DELAY = 0.15, 0.3  # relative misfit; of a sample
HELD = 0.5  # of a sample: between a current that is held and one that is not
RIGLESS = 0.3  # a controlled rotor of unknown controller: its stiffness varies with frequency and looks like mass
TOO_FEW = 12  # lines
SEEN = 0.1  # noise over power of the displacement, up to which a line counts without a rig
LOUD = 100.0  # power over the stated or seen noise of the reading, from which a bin counts
HARMONIC = 3e-3  # of the most powerful line's acceleration, up to which a line may hold distortion of others
FORCE_EFFECTS = ("mass", "sensor_gain", "support_resonance", "sensor_resonance", "friction")
CURRENT_EFFECTS = ("actuator_gain", "mass", "sensor_gain", "eddy_current", "saturation", "hysteresis")
# What turns or bends a response, by what is taken for its cause: what acts before that does not.
BEHIND_FORCE = ("sensor_lag", "support_resonance", "sensor_resonance")
BEHIND_CURRENT = ("sensor_lag", "eddy_current", "support_resonance", "sensor_resonance", "hysteresis", "saturation")
BEHIND_COMMAND = ("sensor_lag", "delay", "eddy_current", "amplifier_lag", "support_resonance", "hysteresis")
DRIVES = ("force", "injection", "reference")
DELAY_EFFECTS = {"force": BEHIND_FORCE, "current": BEHIND_CURRENT}
BENT = ("soft_stop", "force_law")  # what leaves a large part of a motion unexplained
EARLY = ("damping", "friction", "support_resonance", "sensor_resonance")  # beyond its resonance a damped mass leads


def moved(view: View) -> list[Row]:
    """The recorded displacement against that of the stated mass under the recorded force and current.

    The current's share is that of the nominal magnets; without a current, the command or the nominal loop gives it.
    """
    if "displacement" not in view.recorded or view.mass is None:
        return []
    if view.rig is None:
        return _without_rig(view)
    if not view.periodic and not (at_control_rate(view) and _driven(view)):
        return []
    keep = _dominated(view)
    if keep.sum() < TOO_FEW:
        return _without_rig(view)  # a mass that is stated too small seems to dominate nowhere
    lines = view.lines.at(keep)
    nominal = view.nominal(lines.frequency)
    compliance, plant = nominal.receptance / nominal.sensitivity, nominal.plant
    inputs, powers, effects = [], [], []
    pushed = view.place("force")[keep] if lines.periodic else np.full(keep.sum(), "force" in view.recorded)
    drive, response = None, plant
    if view.rig.controlled:
        if "current" in view.recorded:
            drive, response = "current", plant / nominal.amplifier
        elif "command" in view.recorded:
            drive = "command"
        elif "injection" in view.channels:
            drive, response, compliance = "injection", plant * nominal.sensitivity, nominal.receptance
        elif view.gains is not None:
            compliance = nominal.receptance
    if pushed.sum() >= TOO_FEW // 2 and "force" in lines.parts:
        force = lines.parts["force"] * pushed
        if view.hold_rate is None:  # a continuous force: the held one with these lines
            force = force / zero_order_hold(lines.frequency / view.rig.control_rate)
        inputs.append(compliance * force)
        powers.append({"displacement": 1, "force": -1, "mass": 1})
        effects.append(FORCE_EFFECTS)
    if drive is not None:
        inputs.append(response * lines.parts[drive])
        powers.append({"displacement": 1, drive: -1, "mass": 1, "actuator gain": -1})
        effects.append(CURRENT_EFFECTS)
    if not inputs:
        return []
    moving = [lines.parts["displacement"], *inputs]
    if len(inputs) == 2 and not lines.periodic:
        moving = _along_drives(view, lines, moving)
    found = fit(moving[0], moving[1:], lines.frequency, view.rate, lines.periodic)
    if found is None:
        return []
    lag = 0.0
    if found.misfit > SHAPE and len(inputs) == 1:
        lag, _ = low_pass(lines.parts["displacement"], inputs[0], lines.frequency, view.rate, lines.periodic,
                          found.misfit)  # fmt: skip
    middle = float(np.median(lines.frequency))
    rows = [_row(view, found, i, p, e, lag, middle) for i, (p, e) in enumerate(zip(powers, effects, strict=True))]
    if any(row.gain_off() for row in rows):
        shown = _stated_over_shown(view, drive)
        rows = [replace(row, notes={**row.notes, **shown}) for row in rows]
    if "force" in powers[0] and rows[0].gain < 0:  # where a mass dominates that is stated too large, a spring may
        free = _without_rig(view)
        return free if free and free[0].gain > 0 else rows
    return rows


def _along_drives(view: View, lines: Lines, spectra: list[np.ndarray]) -> list[np.ndarray]:
    """Coordinates (drives, n) of spectra (segments, n) along what drives the recording.

    Where a force drives it, the current is what the controller makes of the displacement, noise of the reading
    included. Beside the force that noise is all that a current has of its own: a fit of both to the displacement would
    take what they differ by from the noise alone (a hammer's displacement looked 0.85 times too small).
    """
    drives = [lines.parts[name] for name in DRIVES if name in lines.parts and np.ptp(view.channels[name]) > 0]
    basis, _ = np.linalg.qr(np.stack(drives, axis=-1).transpose(1, 0, 2))  # (n, segments, drives)
    return [np.einsum("nsd,sn->dn", basis.conj(), own) for own in spectra]


def _stated_over_shown(view: View, drive: str | None) -> dict[str, float]:
    """Notes `mass` and `mass_se`: the stated mass over the one that force and displacement show, without the stiffness.

    A row compares displacements at lines where the mass dominates, but the stiffness still holds its part there: of a
    mass of twice the stated one the rows of `hmb_free` have a gain of 0.54. Here stiffness, damping and mass of the
    total force over the displacement are told apart, and the same is made of the nominal rig, so that hold and lags
    have no part in the ratio. The tolerance of the probe counts as an error, of a force by the current that of the
    magnets, too. Empty where there are too few lines.
    """
    use, known = view.place("force") if view.periodic else np.zeros(view.lines.frequency.size, bool), ["probe_gain"]
    if use.sum() < TOO_FEW or "force" not in view.lines.parts:
        if drive is None or not view.periodic:
            return {}
        use, known = view.place("current"), ["probe_gain", "actuator_gain"]
    if use.sum() < TOO_FEW:
        return {}
    lines = view.lines.at(use)
    nominal = view.nominal(lines.frequency)
    compliance = nominal.receptance / nominal.sensitivity
    y = {name: part.mean(axis=0) for name, part in lines.parts.items()}
    moved_by = np.zeros(lines.frequency.size, complex)
    if "force" in y:
        held = 1.0 if view.hold_rate else zero_order_hold(lines.frequency / view.rig.control_rate)
        moved_by = moved_by + compliance * y["force"] * view.place("force")[use] / held
    if drive == "current":
        moved_by = moved_by + nominal.plant / nominal.amplifier * y["current"]
    elif drive == "command":
        moved_by = moved_by + nominal.plant * y["command"]
    elif drive == "injection":
        return {}  # the nominal loop, with the stated mass, has made the current
    w = 2 * np.pi * lines.frequency
    if not (np.abs(moved_by).all() and np.abs(y["displacement"]).all()):
        return {}
    noise = lines.parts["displacement"].var(axis=0, ddof=1) / len(lines.parts["displacement"])
    size = np.sqrt(MODEL**2 + noise / np.abs(y["displacement"]) ** 2)
    (_, _, shown, *_), error, left = _springs(moved_by / compliance / y["displacement"], w, size)
    stated = _springs(1 / compliance, w, size)[0][2]
    if left > SHAPE or shown * stated <= 0:
        return {}
    ratio = float(stated / shown)
    sure = float(np.hypot.reduce([view.rig.tolerance.get(n, KNOWN[n]) for n in known]))
    return {"mass": ratio, "mass_se": ratio * float(np.hypot(error[2] / abs(shown), sure))}


def _row(
    view: View, found: Fit, i: int, powers: dict[str, int], effects: tuple[str, ...], lag: float, middle: float
) -> Row:
    """The comparison with one input; middle: of the frequencies at which it is made, Hz."""
    rig = view.rig
    names = ("mass", "probe_gain", *(("actuator_gain",) if "actuator gain" in powers else ()))
    known = float(np.hypot.reduce([rig.tolerance.get(n, KNOWN[n]) for n in names]))
    source = next(n for n, p in powers.items() if p < 0)
    slack = WIDE * rig.tolerance.get("amplifier_time_constant", 0.1) * rig.amplifier_time_constant
    if source in ("force", "current"):  # behind the amplifier; how a current goes on between readings follows its lag
        slack = HELD / rig.control_rate if source == "current" and view.amplifier_open else 0.0
    late = EARLY if found.delay[i] < 0 else DELAY_EFFECTS.get(source, BEHIND_COMMAND)
    bent = (*late[:4], *BENT) if found.misfit > SHAPE else late
    return Row(
        f"newton {source}", powers, float(found.gain[i]), float(found.gain_se[i]), WIDE * known + STIFFNESS,
        f"the {source} on {view.mass:g} kg", float(found.delay[i]), float(found.delay_se[i]),
        DELAY / rig.control_rate + slack, found.misfit, SHAPE, effects,
        bent, lag, signed=bool(found.gain[i] > 0 or 2 * np.pi * middle * abs(found.delay[i]) < TURNED),
    )  # fmt: skip


def _driven(view: View) -> bool:
    """Whether something besides a force that nobody recorded may drive a recording that never repeats.

    Where such a force alone moves the rotor, the command is what the controller makes of the motion, and the current's
    ratio to that is the controller's.
    """
    if any(name in view.recorded and np.ptp(view.channels[name]) > 0 for name in ("injection", "reference", "force")):
        return True
    return not made_alone(view)


def _dominated(view: View) -> np.ndarray:
    """Lines at which the mass dominates and, where nothing repeats, the rotor moves far beyond its sensor's noise."""
    rig, lines = view.rig, view.lines
    stiffness = rig.support_stiffness + (abs(linearise(force_law(rig))[1]) if rig.controlled else 0.0)
    keep = view.mass * (2 * np.pi * lines.frequency) ** 2 > DOMINATES * stiffness
    if not lines.periodic:
        y = lines.parts["displacement"]
        step = rig.reading_step
        white = max(rig.noise.displacement**2 + step**2 / 12, _floor(view.channels["displacement"]))
        length = round(view.rate / (lines.frequency[1] - lines.frequency[0])) if lines.frequency.size > 1 else 1
        window = 0.375 * length  # power of a Hann window
        loud = (np.abs(y) ** 2).mean(axis=0) > LOUD * max(white * window, 1e-300)
        # A filtered displacement is weak where the recorded current must move the rotor.
        if rig.controlled and "current" in view.recorded:
            nominal, current = view.nominal(lines.frequency), (np.abs(lines.parts["current"]) ** 2).mean(axis=0)
            moving = np.abs(nominal.plant / nominal.amplifier) ** 2 * current > LOUD * white * window
            loud |= moving & (current > LOUD * rig.noise.current**2 * window)
        # Of a chirp or sine, lines beyond hold its harmonics, in which current and motion are not plant and response.
        moved = (np.abs(y) ** 2).mean(axis=0) * lines.frequency**4
        keep &= loud
        keep &= moved > HARMONIC * moved[keep].max(initial=0.0)
    return keep


def _floor(y: np.ndarray) -> float:
    """Variance of white noise as large as what a reading (samples,) holds near half its rate, where no mass moves.

    Where the reading is that noise, the controller has made the current of it: their ratio is the controller's.
    """
    window = np.hanning(y.size)
    spectrum = np.asarray(scipy.fft.rfft((y - y.mean()) * window))
    top = slice(*(int(share * y.size) for share in NOISE_ALONE))
    return float(np.mean(np.abs(spectrum[top]) ** 2) / np.sum(window**2))


def _without_rig(view: View) -> list[Row]:
    """The mass that force and displacement show against the stated one, and the time between them.

    It needs nothing of the rig, and no line at which the stated mass dominates. The time is told by the lines at which
    the shown mass moves. A controller with a filter of time constant T and damping c looks lighter, by c T, and late,
    by c T^2 / m: half of what may be is taken off, and as much of the delay is tolerated.
    """
    if not view.periodic or "force" not in view.recorded:
        return []
    lines = view.lines.at(view.place("force"))
    y = lines.parts["displacement"]
    noise = y.var(axis=0, ddof=1) / len(y) / np.maximum(np.abs(y.mean(axis=0)) ** 2, 1e-300)
    lines, noise = lines.at(noise < SEEN), noise[noise < SEEN]
    force, y = lines.parts["force"].mean(axis=0), lines.parts["displacement"].mean(axis=0)
    if lines.frequency.size < TOO_FEW or not (np.abs(force).all() and np.abs(y).all()):
        return []
    w = 2 * np.pi * lines.frequency
    if view.hold_rate:
        force = force * zero_order_hold(lines.frequency / view.hold_rate)
    size = np.sqrt(MODEL**2 + noise)
    (stiffness, damping, mass, *_), error, left = _springs(force / y, w, size)
    if left > RIGLESS or abs(mass) * w[-1] ** 2 < DOMINATES * abs(stiffness):
        return []  # no one mass moves, or it is not seen
    filtered = FILTERED / view.rate
    lighter = max(damping, 0.0) * filtered / 2 if mass > 0 else 0.0
    delay = None
    if view.rig is None:
        moves = abs(mass) * w**2 > MOVES * abs(stiffness)
        if moves.sum() >= TOO_FEW:
            delay = _late(filtered, view.rate, *_springs(force[moves] / y[moves], w[moves], size[moves]))
    late, late_se, tolerance = delay or (None, 0.0, 0.0)
    return [
        Row("newton force", {"displacement": 1, "force": -1, "mass": 1}, float(view.mass / (mass + lighter)),
            float(error[2] / abs(mass)), RIGLESS, f"the force on {view.mass:g} kg", late, late_se, tolerance,
            gain_effects=FORCE_EFFECTS, delay_effects=BEHIND_FORCE)
    ]  # fmt: skip


def _springs(z: np.ndarray, w: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """k, c, m, h and b of z = k - m w^2 + j (w c - h / w - b w^3), their errors, and the relative misfit.

    h is that of an integrating controller; b / m is a delay, because exp(jwd) turns m w^2 by m d w^3.

    Args:
        z: Force over displacement, (n,).
        w: (n,), rad/s.
        size: Relative error of z, (n,).
    """
    columns = np.stack([np.ones_like(z), 1j * w, -(w**2), -1j / w, -1j * w**3]) / (np.abs(z) * size)
    scale = np.linalg.norm(columns, axis=1)
    real = np.concatenate([columns.real, columns.imag], axis=1) / scale[:, None]
    unit = z / (np.abs(z) * size)
    wanted = np.concatenate([unit.real, unit.imag])
    found, *_ = np.linalg.lstsq(real.T, wanted, rcond=None)
    off = wanted - found @ real
    error = np.sqrt(np.maximum(np.diag(np.linalg.pinv(real @ real.T)), 0.0) * np.mean(off**2))
    return found / scale, error / scale, float(np.sqrt((off**2).sum() / (wanted**2).sum()))


def _late(
    filtered: float, rate: float, found: np.ndarray, error: np.ndarray, left: float
) -> tuple[float, float, float] | None:
    """Delay, its error and tolerance, s; None where no one mass moves."""
    _, damping, mass, _, bent = found
    if left > RIGLESS or mass <= 0:
        return None
    loop = max(damping, 0.0) / mass * filtered**2 / 2
    return float(bent / mass - loop), float(error[4] / mass), float(loop + LATE / rate)
