"""The recorded command against what the stated controller makes of the recorded displacement."""

import numpy as np

from maglev_env.loop.gains import Controller, Gains, controller_response, form_of, linear_ones
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import LEAST_LINES, Fit, Row, fit
from maglev_env.redundancy.view import View

GAIN, DELAY = 0.02, 0.15  # what rounding and another channel's clock may do: relative, and of a sample
SHAPE = 0.03  # relative misfit
CLEARLY = 0.3  # of the misfit: a repair that leaves less is believed
NOTHING = 1e-9
LEVELS, CUT, LONGER = 100, 3, 2.5  # of a command: fewer levels are steps; samples at a limit, at least and to the next


def controlled(view: View) -> list[Row]:
    """Gain and delay from the displacement to the command, and from what is injected to the command.

    A digital controller computes its command exactly; what remains is rounding, which the mean over periods averages.
    Without injection or reference in the file, a recording that does not repeat tells nothing: what was added to its
    command is then found by this very relation.
    """
    if not applies(view):
        return []
    found = compared(view, view.gains)
    if found is None:
        return []
    again, driven = found
    at = view.rig.control_rate
    common = {"tolerance": GAIN, "delay_tolerance": DELAY / at, "most_misfit": SHAPE}
    words = "what the stated controller makes of the displacement"
    lag, twist = (0.0, 0.0) if again.misfit <= SHAPE else _filtered(view, again.misfit)
    rows = [
        Row("controller", {"command": 1, "displacement": -1, "gains": -1}, float(again.gain[0]),
            float(again.gain_se[0]), against=words, delay=again.time(0), delay_se=float(again.delay_se[0]),
            misfit=again.misfit, lag=lag, notes={"twist": twist}, **common)
    ]  # fmt: skip
    if driven:
        name = "injection" if "injection" in view.channels else "reference"
        rows.append(
            Row("injection to command", {"command": 1, name: -1}, float(again.gain[1]), float(again.gain_se[1]),
                against=f"the {name}", delay=again.time(1), delay_se=float(again.delay_se[1]), **common)
        )  # fmt: skip
    return rows


def applies(view: View) -> bool:
    """Whether the relation can be looked at."""
    if view.rig is None or not view.rig.controlled or view.gains is None:
        return False
    if any(one.limit is not None or one.reads_current for one in linear_ones(view.gains, 1 / view.rig.control_rate)):
        return False  # the command does not follow from the displacement by a linear filter
    if not {"displacement", "command"} <= view.recorded or cut_off(view.channels["command"]):
        return False
    return view.periodic or (("injection" in view.recorded or "reference" in view.recorded) and at_control_rate(view))


def cut_off(command: np.ndarray) -> bool:
    """Whether a command (samples,) reaches a limit, be it for single samples as by the kick of a derivative at steps.

    The outermost level of a signal that has no limit is rare, and that of a sine twice as frequent as the next.
    """
    levels, counts = np.unique(command, return_counts=True)
    ends = ((0, 1), (-1, -2)) if levels.size >= LEVELS else ()
    return any(counts[i] >= CUT and counts[i] > LONGER * counts[j] for i, j in ends)


def at_control_rate(view: View) -> bool:
    return view.rig is not None and abs(view.rate / view.rig.control_rate - 1) < 1e-9


def compared(view: View, gains: Controller | None) -> tuple[Fit, bool] | None:
    """The fit under a controller, and whether something drives the loop at its command."""
    lines, parts = view.lines, view.lines.parts
    if gains is None:
        return None
    z, dt = np.exp(2j * np.pi * lines.frequency / view.rig.control_rate), 1 / view.rig.control_rate
    response = controller_response(gains, z, dt)
    out, back = parts["command"], -response * parts["displacement"]
    drive = np.zeros_like(out)
    if "injection" in parts:
        drive = drive + parts["injection"]
    if "reference" in parts:
        drive = drive + controller_response(gains, z, dt, "reference") * parts["reference"]
    # What is not driven at the command holds only rounding there.
    moved = np.abs(drive).mean(axis=0) > NOTHING * np.abs(drive).max(initial=0.0)
    driven = int(moved.sum()) >= LEAST_LINES
    found = fit(out, [back, drive] if driven else [back], lines.frequency, view.rate, lines.periodic)
    return None if found is None else (found, driven)


def _filtered(view: View, misfit: float) -> tuple[float, float]:
    """Time constant of a low-pass on the command (> 0) or on the displacement (< 0) that explains the misfit.

    The second value is 1 where the injection is the filtered channel.
    """
    lines, parts = view.lines, view.lines.parts
    z, dt = np.exp(2j * np.pi * lines.frequency / view.rig.control_rate), 1 / view.rig.control_rate
    response = controller_response(view.gains, z, dt)
    drive = parts.get("injection", np.zeros_like(parts["command"]))
    if "reference" in parts:
        drive = drive + controller_response(view.gains, z, dt, "reference") * parts["reference"]
    best, found = CLEARLY * misfit, (0.0, 0.0)
    total = parts["command"].mean(axis=0) if lines.periodic else parts["command"].ravel()
    for size in np.geomspace(0.05, 200.0, 60) / view.rate:
        pole = 1 / (1 + 2j * np.pi * lines.frequency * size)
        for who, command, shown, added in (
            ("command", parts["command"] / pole, parts["displacement"], drive),
            ("displacement", parts["command"], parts["displacement"] / pole, drive),
            ("injection", parts["command"], parts["displacement"], drive / pole),
        ):
            rest = command + response * shown - added
            rest = rest.mean(axis=0) if lines.periodic else rest.ravel()
            left = float(np.sqrt((np.abs(rest) ** 2).sum() / (np.abs(total) ** 2).sum()))
            if left < best:
                best, found = left, ({"command": size, "displacement": -size, "injection": size}[who],
                                     float(who == "injection"))  # fmt: skip
    return found


def stated_gains(view: View) -> list[Finding]:
    """Which controller of the campaign's other recordings fits instead of the stated one."""
    if not applies(view) or not view.others:
        return []
    own = compared(view, view.gains)
    if own is None or not _bad(own[0], view):
        return []
    for other in view.others:
        found = compared(view, other)
        if found is not None and not _bad(found[0], view):
            words = _words(other)
            text = (
                f"controller: the command is not what the stated gains make of the displacement (factor "
                f"{own[0].gain[0]:.3g}, misfit {own[0].misfit:.1%}), but what {words} make of it, which other "
                "recordings of this campaign state; correct the gains of this recording"
            )
            return [Finding("gains", view.recording, "gains", float(own[0].gain[0]), None, text, "contradiction")]
    return []


def _bad(found: Fit, view: View) -> bool:
    return bool(
        np.abs(np.log(np.maximum(np.abs(found.gain), 1e-12))).max() > GAIN
        or (found.gain < 0).any()
        or np.abs(found.delay).max() * view.rig.control_rate > DELAY
        or found.misfit > SHAPE
    )


def _words(controller: Controller) -> str:
    if isinstance(controller, Gains):
        return f"kp = {controller.kp:g}, ki = {controller.ki:g}, kd = {controller.kd:g}"
    form = form_of(controller)
    return f'the controller of the form "{form}"' if form else "the numerator and denominator"
