"""What the commands of a file show of its controllers, as a campaign states them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.recordings.guess.controller import NO_LEAK, ControllerFit, fit_controller
from maglev_env.recordings.guess.controller_forms import fit_form
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, SURE, Guess

_EACH = "the controllers: [recording.gains.x] and [recording.gains.y]"
_TOWARD = "whether the displacement is measured away from the magnet (kp is negative): scale < 0"
SAME_GAIN = 0.03  # relative difference of gains that were fitted to two files of one controller
_SAME_AXES = 1e-3  # the same of two axes of one file, but for a slow integral, which is told the least
_SEEN = ("reference", "injection", "current")
_FORMS = {
    "pid": "a PID with other paths for displacement and reference",
    "state_feedback": "a feedback of displacement, its slope and the current",
}
# What a controller has per metre of its reading.
_PER_METRE = frozenset(["kp", "ki", "kd", "displacement", "velocity", "integral"])


def rescaled(table: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """A controller's table for a displacement whose scale has changed by a factor."""
    return {
        name: float(f"{value / factor:.7g}") + 0.0 if name in _PER_METRE else value for name, value in table.items()
    }


def asked_of(table: Mapping[str, Any]) -> str:
    """What is to be asked of a controller's table: its sign, where the displacement seems to count the other way."""
    return "" if table.get("kp", table.get("displacement", 1.0)) > 0 else _TOWARD


def said_of_the_integral(gains: Mapping[str, float], rate: float) -> tuple[str, str]:
    """What ki and ti mean together, and, where no leak is told, the line that states the same in the form "pid"."""
    if not gains["ki"]:
        return "", ""
    said = f"the integral gain, ki / ti, is {gains['ki'] / gains['ti']:.4g} A/(m s)"
    if gains["ti"] != NO_LEAK:
        return said, ""
    said += (
        f"; the recording tells no leak of it, for which ti = {NO_LEAK:g} s stands. A PID with a pure integral and "
        "backward differences says the same in these numbers:"
    )
    return said, f"controller = {toml_value(without_leak(gains, rate))}"


def without_leak(gains: Mapping[str, float], rate: float) -> dict[str, Any]:
    """The form "pid" that does the same as gains with a long ti, at a rate (Hz).

    Its ki is ki / ti, in A/(m s). Its recursion has other numbers: its integral holds the newest error too, and the
    filter of its derivative is a backward difference.
    """
    step, told = 1 / rate, {"kp": gains["kp"], "ki": gains["ki"] / gains["ti"]}
    told["kp"] -= told["ki"] * step
    if gains["kd"] and gains["td"]:
        td = step / np.expm1(step / gains["td"])
        told |= {"kd": gains["kd"] * (td + step) / gains["td"], "td": td}
    return {"form": "pid"} | {name: float(f"{value:.5g}") for name, value in told.items()}


Told = tuple[dict[str, float] | None, Mapping[str, Any] | None, Guess]


def controllers(channels: Mapping[str, np.ndarray], known: np.ndarray, rate: float | None) -> Told:
    """The controller that the commands of a file show.

    Args:
        channels: in SI, (samples,) each.
        known: samples that count, (samples,) bool.
        rate: Hz; None: not known.

    Returns:
        Gains, or a controller of another form, and the evidence; of two axes what both have, else what is said of x.
    """
    if "displacement_x" not in channels:
        return _controller(channels, known, rate)
    each = [
        _controller({n.removesuffix(axis): v for n, v in channels.items() if n.endswith(axis)}, known, rate)
        for axis in ("_x", "_y")
    ]
    (of_x, form, said), (of_y, other, _) = each
    if form and form == other:
        return None, form, replace(said, reason=f"in x, and in y likewise: {said.reason}")
    if form or other:
        found = "; ".join(f"{axis}: {one or 'not known'}" for axis, one in (("x", form or of_x), ("y", other or of_y)))
        return None, None, Guess("controller", None, f"the axes have controllers of their own ({found})", OPEN, _EACH)
    if of_x and of_y and alike(of_x, of_y, _SAME_AXES, everything=True):
        return of_x, None, replace(said, reason=f"in x, and in y likewise: {said.reason}")
    if of_x and of_y:
        found = "; ".join(
            f"{axis}: {', '.join(f'{n} = {v:.5g}' for n, v in g.items())}"
            for axis, g in zip("xy", (of_x, of_y), strict=True)
        )
        return None, None, Guess("controller", None, f"each axis has a PID of its own ({found})", OPEN, _EACH)
    return None, None, replace(said, value=None)


def alike(one: Mapping[str, float], other: Mapping[str, float], tolerance: float, everything: bool = False) -> bool:
    """Whether two PIDs do the same; an integral with a long leak is told by its slope, and that to SAME_GAIN at best.

    Args:
        one, other: gains.
        tolerance: relative difference that they may have.
        everything: whether both must have the same parts; else they may differ in what only one of them has.
    """
    pairs = [
        (a["kp"], a["kd"] / (a["td"] or 1.0), a["td"] if a["kd"] else 0.0, a["ki"] / (a["ti"] or 1.0))
        for a in (one, other)
    ]
    allowed = (tolerance, tolerance, tolerance, max(tolerance, SAME_GAIN))
    return all(
        (a * b == 0 and not everything) or abs(a - b) <= most * max(abs(a), abs(b))
        for most, a, b in zip(allowed, *pairs, strict=True)
    )


def _controller(channels: Mapping[str, np.ndarray], known: np.ndarray, rate: float | None) -> Told:
    ask = "the controller: gains = { kp, ki, kd, td, ti } or controller = { numerator, denominator }"
    if not {"displacement", "command"} <= channels.keys():
        return None, None, Guess("controller", None, "it takes displacement and command to tell", 0.0, ask)
    if not rate:
        return None, None, Guess("controller", None, "it takes the sample rate to tell", 0.0, ask)
    fit = fit_controller(
        channels["displacement"], channels["command"], rate, channels.get("reference"), channels.get("injection"), known
    )
    if fit is None:
        return None, None, Guess("controller", None, "the command does not move", 0.0, ask)
    if not fit.close or fit.late:
        seen = (channels.get(name) for name in _SEEN)
        form = None
        if not fit.close:
            form = fit_form(channels["displacement"], channels["command"], rate, *seen, known)
        if form is None:
            return None, None, Guess("controller", None, _not_a_pid(fit), OPEN, ask)
        kind = _FORMS[form.table["form"]]
        reason = f"the command is {kind} to {form.residual:.2g} A rms, {form.share:.1g} of its motion"
        return None, form.table, Guess("controller", form.table, reason, LIKELY, asked_of(form.table))
    g = fit.gains
    gains = {name: float(f"{getattr(g, name):.7g}") for name in ("kp", "ki", "kd", "td", "ti")}
    stepped = np.isfinite(fit.step) and fit.residual <= fit.step
    how = f"one step of its converter ({fit.step:.3g} A)" if stepped else "what the digits of the columns leave"
    to = f"the command is a PID of the displacement to {fit.residual:.2g} A rms"
    reason = f"{to}, within {how}" if fit.exact else f"{to}, {np.sqrt(fit.share):.1g} of its motion"
    sure = SURE if fit.exact else LIKELY
    return gains, None, Guess("controller", gains, reason, sure, asked_of(gains), fit.share)


def _not_a_pid(fit: ControllerFit) -> str:
    if fit.close:
        g = fit.gains
        return (
            f"the command is a PID of the displacement one sample before (kp {g.kp:.4g}, ki {g.ki:.4g}, kd {g.kd:.4g}, "
            f"td {g.td:.3g} s, ti {g.ti:.3g} s): state it as controller with its delay"
        )
    return (
        f"the command is no PID of the displacement alone: the best leaves {fit.share:.2g} of its power, "
        f"{fit.residual:.2g} A rms (another form, a decimated or filtered log, a limit, or "
        "something unstored in the command)"
    )
