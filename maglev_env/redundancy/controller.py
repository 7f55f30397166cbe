"""The recorded command against what the stated controller makes of the recorded displacement."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.loop.gains import (
    Controller,
    Gains,
    controller_output,
    controller_response,
    form_of,
    linear_ones,
    reads_current,
)
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rounded import told
from maglev_env.redundancy.rows import LEAST_LINES, Fit, Row, fit
from maglev_env.redundancy.view import View

GAIN, DELAY = 0.02, 0.15  # what rounding and another channel's clock may do: relative, and of a sample
SHAPE = 0.03  # relative misfit
CLEARLY = 0.3  # of the misfit: a repair that leaves less is believed
NOTHING = 1e-9
READ = ("displacement", "reference", "current")
AT_LIMIT = 0.01  # of a controller's range: how near its ends it is taken as limited
LEVELS, CUT, LONGER = 100, 3, 2.5  # of a command: fewer levels are steps; samples at a limit, at least and to the next


def controlled(view: View) -> list[Row]:
    """Gain and delay from the displacement to the command, and from what is injected to the command.

    A digital controller computes its command exactly; what remains is rounding, which the mean over periods averages.
    Where it reached its limit, or nothing repeats, it is computed sample by sample.
    Without injection or reference in the file, a recording that does not repeat tells nothing: what was added to its
    command is then found by this very relation.
    """
    if not applies(view):
        return []
    found = compared(view, view.gains)
    if found is None:
        return []
    again = found.fit
    at = view.rig.control_rate
    common = {"tolerance": GAIN, "delay_tolerance": DELAY / at, "most_misfit": SHAPE}
    words = "what the stated controller makes of the displacement"
    lag, twist = (0.0, 0.0) if again.misfit <= SHAPE else _filtered(view, found)
    rows = [
        Row("controller", {"command": 1, "displacement": -1, "gains": -1}, float(again.gain[0]),
            float(again.gain_se[0]), against=words, delay=again.time(0), delay_se=float(again.delay_se[0]),
            misfit=again.misfit, lag=lag, notes={"twist": twist}, **common)
    ]  # fmt: skip
    if found.driven:
        name = "injection" if "injection" in view.channels else "reference"
        rows.append(_added(view, name, again))
    if found.driven and found.refers and "injection" in view.channels and not _bad(again, view):
        lines = view.lines  # beside a large injection the reference is told only with that taken off
        rest = lines.parts["command"] - (found.drive - found.referred)
        second = fit(rest, [found.back, found.referred], lines.frequency, view.rate, lines.periodic)
        rows += [] if second is None else [_added(view, "reference", second)]
    return rows


def _added(view: View, name: str, found: Fit) -> Row:
    powers = {"command": 1, name: -1} | ({"gains": -1} if name == "reference" else {})
    return Row(
        f"{name} to command", powers, float(found.gain[1]), float(found.gain_se[1]), GAIN, f"the {name} in the command",
        found.time(1), float(found.delay_se[1]), DELAY / view.rig.control_rate, most_misfit=SHAPE,
    )  # fmt: skip


def applies(view: View) -> bool:
    """Whether the relation can be looked at."""
    if view.rig is None or not view.rig.controlled or view.gains is None:
        return False
    inputs = {"displacement", "current"} if reads_current(view.gains, 1 / view.rig.control_rate) else {"displacement"}
    if not {*inputs, "command"} <= view.recorded:
        return False
    if limited_in(view, view.gains):
        if not at_control_rate(view):
            return False
    elif "command" in view.railed or cut_off(view.channels["command"]):
        return False
    added = any(name in view.recorded and np.ptp(view.channels[name]) > 0 for name in ("injection", "reference"))
    return view.periodic or (added and at_control_rate(view))


def limited_in(view: View, gains: Controller) -> bool:
    """Whether a controller with a limit reached it."""
    for one in linear_ones(gains, 1 / view.rig.control_rate):
        if one.limit is not None:
            (low, high), own = one.limit, view.channels["command"] - view.channels.get("injection", 0.0)
            near = AT_LIMIT * (high - low)
            return bool(own.max() > high - near or own.min() < low + near)
    return False


def cut_off(command: np.ndarray) -> bool:
    """Whether a command (samples,) reaches a limit, be it for single samples as by the kick of a derivative at steps.

    The outermost level of a signal that has no limit is rare, and that of a sine twice as frequent as the next.
    """
    levels, counts = np.unique(command, return_counts=True)
    ends = ((0, 1), (-1, -2)) if levels.size >= LEVELS else ()
    return any(counts[i] >= CUT and counts[i] > LONGER * counts[j] for i, j in ends)


def at_control_rate(view: View) -> bool:
    return view.rig is not None and abs(view.rate / view.rig.control_rate - 1) < 1e-9


@dataclass(frozen=True)
class Compared:
    """The fit under a controller, and spectra (s, n): what it makes of what it reads, and what is added to that.

    `driven`: whether anything is added. `referred`: the reference's share in that; None without one.
    """

    fit: Fit
    back: np.ndarray
    drive: np.ndarray
    driven: bool
    referred: np.ndarray | None

    @property
    def refers(self) -> bool:
        """Whether the reference moves: of a constant one only rounding is left."""
        return self.referred is not None and bool(np.abs(self.referred).max() > NOTHING * np.abs(self.drive).max())


def compared(view: View, gains: Controller | None) -> Compared | None:
    """The command against a controller's."""
    if gains is None:
        return None
    lines, best = view.lines, None
    seen = told(view, "reference") if "reference" in lines.parts else None
    for back, injection, made in _made(view, gains):
        # What rounds the reference in its file has never reached the controller.
        referred = None if made is None else np.where(seen, made, 0.0)
        drive = injection if referred is None else injection + referred
        driven = int(moving(drive, lines.parts["command"]).sum()) >= LEAST_LINES
        inputs = [back, drive] if driven else [back]
        found = fit(lines.parts["command"], inputs, lines.frequency, view.rate, lines.periodic)
        if found is not None and (best is None or found.cost < best.fit.cost):
            best = Compared(found, back, drive, driven, referred)
        if best is not None and not _bad(best.fit, view):
            break
    return best


def moving(drive: np.ndarray, command: np.ndarray) -> np.ndarray:
    """On which lines (n,) a drive of a command acts, spectra (s, n): elsewhere it holds only rounding, and so does all
    of what was turned away from this axis."""
    most = max(np.abs(drive).max(initial=0.0), np.abs(command).max(initial=0.0))
    return np.abs(drive).mean(axis=0) > NOTHING * most


def made_alone(view: View) -> bool:
    """Whether the stated controller makes all of the command of what it reads, so that nobody has added anything."""
    if view.gains is None or not {"displacement", "command"} <= view.recorded:
        return False
    if reads_current(view.gains, 1 / view.rig.control_rate) and "current" not in view.recorded:
        return False
    found = compared(view, view.gains)
    return found is not None and not found.driven and not _bad(found.fit, view)


def _made(view: View, gains: Controller) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray | None]]:
    """Spectra (s, n) of what a controller makes of what it reads, of the injection, and of its share of the reference.

    Where nothing repeats, segments hold what came before them, so the controller runs through the whole record: from
    rest, or from its mean if the record began before, which a controller that integrates cannot take. A short one may
    still be told best by its response alone.
    """
    lines, parts = view.lines, view.lines.parts
    injection = parts.get("injection", np.zeros_like(parts["command"]))
    dt = 1 / view.rig.control_rate
    read = {name: view.channels[name] for name in READ if name in view.channels}
    if limited_in(view, gains):  # the reference acts before the limit, together with the reading
        yield _run(view, gains, read), injection, None
        return
    if not lines.periodic:
        for inputs in (read, {name: values - values.mean() for name, values in read.items()}):
            reference, referred = inputs.pop("reference", None), None
            if reference is not None:
                referred = _run(view, gains, {"displacement": np.zeros_like(reference), "reference": reference})
            yield _run(view, gains, inputs), injection, referred
    z = np.exp(2j * np.pi * lines.frequency * dt)
    back = -controller_response(gains, z, dt) * parts["displacement"]
    if reads_current(gains, dt):
        back = back - controller_response(gains, z, dt, "current") * parts["current"]
    referred = None
    if "reference" in parts:
        referred = controller_response(gains, z, dt, "reference") * parts["reference"]
    yield back, injection, referred


def _run(view: View, gains: Controller, read: Mapping[str, np.ndarray]) -> np.ndarray:
    made = controller_output(gains, dt=1 / view.rig.control_rate, **read)
    return replace(view, channels={**view.channels, "command": made}).lines.parts["command"]


def _filtered(view: View, found: Compared) -> tuple[float, float]:
    """Time constant of a low-pass on the command (> 0) or on the displacement (< 0) that explains the misfit.

    The second value is 1 where the injection is the filtered channel.
    """
    lines, command, back, drive = view.lines, view.lines.parts["command"], found.back, found.drive
    best, lag = CLEARLY * found.fit.misfit, (0.0, 0.0)
    total = command.mean(axis=0) if lines.periodic else command.ravel()
    for size in np.geomspace(0.05, 200.0, 60) / view.rate:
        pole = 1 / (1 + 2j * np.pi * lines.frequency * size)
        for who, rest in (
            ("command", command / pole - back - drive),
            ("displacement", command - back / pole - drive),
            ("injection", command - back - drive / pole),
        ):
            rest = rest.mean(axis=0) if lines.periodic else rest.ravel()
            left = float(np.sqrt((np.abs(rest) ** 2).sum() / (np.abs(total) ** 2).sum()))
            if left < best:
                best = left
                lag = {"command": size, "displacement": -size, "injection": size}[who], float(who == "injection")
    return lag


def stated_gains(view: View) -> list[Finding]:
    """Which controller of the campaign's other recordings fits instead of the stated one."""
    if not applies(view) or not view.others:
        return []
    own = compared(view, view.gains)
    if own is None or not _bad(own.fit, view):
        return []
    for other in view.others:
        found = compared(view, other)
        if found is not None and not _bad(found.fit, view):
            words = _words(other)
            text = (
                f"controller: the command is not what the stated gains make of the displacement (factor "
                f"{own.fit.gain[0]:.3g}, misfit {own.fit.misfit:.1%}), but what {words} make of it, which other "
                "recordings of this campaign state; correct the gains of this recording"
            )
            return [Finding("gains", view.recording, "gains", float(own.fit.gain[0]), None, text, "contradiction")]
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
