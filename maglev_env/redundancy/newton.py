"""Force, current and displacement against each other by Newton's law with the stated mass.

Only lines count at which the mass dominates: there the stiffness, which effects change most, hardly matters.
"""

import numpy as np
import scipy

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.redundancy.controller import at_control_rate
from maglev_env.redundancy.rows import MODEL, Fit, Row, fit, low_pass
from maglev_env.redundancy.view import View

DOMINATES = 1.5  # m w^2 over the stiffness, from which a line counts
WIDE = 4.0  # standard deviations of the tolerances
KNOWN = {"mass": 0.01, "probe_gain": 0.03, "actuator_gain": 0.1}  # relative, where the rig states no tolerance
STIFFNESS = 0.05  # what an error of the stiffness may do at these lines
SHAPE, DELAY = 0.15, 0.3  # relative misfit; of a sample
RIGLESS = 0.3  # a controlled rotor of unknown controller: its stiffness varies with frequency and looks like mass
TOO_FEW = 12  # lines
SEEN = 0.1  # noise over power of the displacement, up to which a line counts without a rig
LOUD = 100.0  # power over the stated or seen noise of the reading, from which a bin counts
FLOOR = (0.40, 0.49)  # of the rate: where a reading is taken to be noise alone
FORCE_EFFECTS = ("mass", "sensor_gain", "support_resonance", "sensor_resonance", "friction")
CURRENT_EFFECTS = ("actuator_gain", "mass", "sensor_gain", "eddy_current", "saturation", "hysteresis")
DELAY_EFFECTS = ("sensor_lag", "delay", "eddy_current", "amplifier_lag", "support_resonance", "sensor_resonance")


def moved(view: View) -> list[Row]:
    """The recorded displacement against that of the stated mass under the recorded force and current.

    The current's share is that of the nominal magnets; without a current, the command or the nominal loop gives it.
    """
    if "displacement" not in view.recorded or view.mass is None:
        return []
    if view.rig is None:
        return _without_rig(view)
    if not view.periodic and not at_control_rate(view):
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
            x = lines.frequency / view.rig.control_rate
            force = force / (np.sinc(x) * np.exp(-1j * np.pi * x))
        inputs.append(compliance * force)
        powers.append({"displacement": 1, "force": -1, "mass": 1})
        effects.append(FORCE_EFFECTS)
    if drive is not None:
        inputs.append(response * lines.parts[drive])
        powers.append({"displacement": 1, drive: -1, "mass": 1, "actuator gain": 1})
        effects.append(CURRENT_EFFECTS)
    if not inputs:
        return []
    found = fit(lines.parts["displacement"], inputs, lines.frequency, view.rate, lines.periodic)
    if found is None:
        return []
    lag = 0.0
    if found.misfit > SHAPE and len(inputs) == 1:
        lag, _ = low_pass(lines.parts["displacement"], inputs[0], lines.frequency, view.rate, lines.periodic,
                          found.misfit)  # fmt: skip
    rows = [_row(view, found, i, p, e, lag) for i, (p, e) in enumerate(zip(powers, effects, strict=True))]
    if "force" in powers[0] and rows[0].gain < 0:  # where a mass dominates that is stated too large, a spring may
        free = _without_rig(view)
        return free if free and free[0].gain > 0 else rows
    return rows


def _row(view: View, found: Fit, i: int, powers: dict[str, int], effects: tuple[str, ...], lag: float) -> Row:
    rig = view.rig
    names = ("mass", "probe_gain", *(("actuator_gain",) if "actuator gain" in powers else ()))
    known = float(np.hypot.reduce([rig.tolerance.get(n, KNOWN[n]) for n in names]))
    source = next(n for n, p in powers.items() if p < 0)
    slack = WIDE * rig.tolerance.get("amplifier_time_constant", 0.1) * rig.amplifier_time_constant
    return Row(
        f"newton {source}", powers, float(found.gain[i]), float(found.gain_se[i]), WIDE * known + STIFFNESS,
        f"the {source} on {view.mass:g} kg", float(found.delay[i]), float(found.delay_se[i]),
        DELAY / rig.control_rate + slack * (source not in ("force", "current")), found.misfit, SHAPE, effects,
        DELAY_EFFECTS, lag,
    )  # fmt: skip


def _dominated(view: View) -> np.ndarray:
    """Lines at which the mass dominates and, where nothing repeats, the rotor moves far beyond its sensor's noise."""
    rig, lines = view.rig, view.lines
    stiffness = rig.support_stiffness + (abs(linearise(force_law(rig))[1]) if rig.controlled else 0.0)
    keep = view.mass * (2 * np.pi * lines.frequency) ** 2 > DOMINATES * stiffness
    if not lines.periodic:
        y = lines.parts["displacement"]
        step = 2 * rig.voltage_range / 2**rig.adc_bits / rig.probe_gain if rig.adc_bits else 0.0
        white = max(rig.noise.displacement**2 + step**2 / 12, _floor(view.channels["displacement"]))
        length = round(view.rate / (lines.frequency[1] - lines.frequency[0])) if lines.frequency.size > 1 else 1
        window = 0.375 * length  # power of a Hann window
        loud = (np.abs(y) ** 2).mean(axis=0) > LOUD * max(white * window, 1e-300)
        # A filtered displacement is weak where the recorded current must move the rotor.
        if rig.controlled and "current" in view.recorded:
            nominal, current = view.nominal(lines.frequency), (np.abs(lines.parts["current"]) ** 2).mean(axis=0)
            moving = np.abs(nominal.plant / nominal.amplifier) ** 2 * current > LOUD * white * window
            loud |= moving & (current > LOUD * rig.noise.current**2 * window)
        keep &= loud
    return keep


def _floor(y: np.ndarray) -> float:
    """Variance of white noise as large as what a reading (samples,) holds near half its rate, where no mass moves.

    Where the reading is that noise, the controller has made the current of it: their ratio is the controller's.
    """
    window = np.hanning(y.size)
    spectrum = np.asarray(scipy.fft.rfft((y - y.mean()) * window))
    top = slice(*(int(share * y.size) for share in FLOOR))
    return float(np.mean(np.abs(spectrum[top]) ** 2) / np.sum(window**2))


def _without_rig(view: View) -> list[Row]:
    """The mass that force and displacement show against the stated one: F = (k - m w^2 + j w c) Y over all lines.

    It needs nothing of the rig, and no line at which the stated mass dominates.
    """
    if not view.periodic or "force" not in view.recorded:
        return []
    lines = view.lines.at(view.place("force"))
    y = lines.parts["displacement"]
    noise = y.var(axis=0, ddof=1) / len(y) / np.maximum(np.abs(y.mean(axis=0)) ** 2, 1e-300)
    lines, noise = lines.at(noise < SEEN), noise[noise < SEEN]
    if lines.frequency.size < TOO_FEW:
        return []
    force, y = lines.parts["force"].mean(axis=0), lines.parts["displacement"].mean(axis=0)
    w = 2 * np.pi * lines.frequency
    if view.hold_rate:
        x = lines.frequency / view.hold_rate
        force = force * np.sinc(x) * np.exp(-1j * np.pi * x)
    size = np.maximum(np.abs(force), 1e-12 * np.abs(force).max()) * np.sqrt(MODEL**2 + noise)
    columns = np.stack([y, 1j * w * y, -(w**2) * y]) / size  # relative errors, with the noise of the displacement
    scale = np.linalg.norm(columns, axis=1)
    if not scale.all():
        return []
    real = np.concatenate([columns.real, columns.imag], axis=1) / scale[:, None]
    wanted = np.concatenate([(force / size).real, (force / size).imag])
    found, *_ = np.linalg.lstsq(real.T, wanted, rcond=None)
    off = wanted - found @ real
    left = float(np.sqrt((off**2).sum() / (wanted**2).sum()))
    error = np.sqrt(np.diag(np.linalg.pinv(real @ real.T)) * np.mean(off**2))
    stiffness, _, mass = found / scale
    if left > RIGLESS or abs(mass) * w[-1] ** 2 < DOMINATES * abs(stiffness):
        return []  # no one mass moves, or it is not seen
    return [
        Row("newton force", {"displacement": 1, "force": -1, "mass": 1}, float(view.mass / mass),
            float(abs(error[2] / scale[2] / mass)), RIGLESS, f"the force on {view.mass:g} kg",
            gain_effects=FORCE_EFFECTS, delay_effects=DELAY_EFFECTS)
    ]  # fmt: skip
