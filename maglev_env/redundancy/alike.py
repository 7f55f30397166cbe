"""A command that is what was injected, or the reference: one signal was recorded under two names."""

import numpy as np

from maglev_env.loop.gains import controller_response
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import fit
from maglev_env.redundancy.view import View

SAME = 1e-6  # of a channel's range: what digits of a file leave between copies
# Copies that noise, few digits or other converters tell apart: what is left at the driven lines beside a factor and a
# delay (samples). A loop leaves more where lines are so far apart (as a ratio): S is not the same at all of them.
LEFT, LATE, APART = 3e-3, 3.0, 3.0
DRIVEN = 1e-3  # of the strongest line's power
POINTS = 32  # of the unit circle, at which a controller that does nothing is nothing


def alike(view: View) -> list[Finding]:
    """The command as a copy of the injection or reference, which no loop that is closed has.

    Sensitivity, margins and gains that follow from it would be those of no loop at all: abs(S) = 1 at every line.
    """
    if "command" not in view.recorded or _open(view):
        return []
    for name in ("injection", "reference"):
        if name not in view.recorded:
            continue
        exactly = _copies(view.channels["command"], view.channels[name])
        if exactly or _same_at_lines(view, name):
            columns = [view.columns.get(n, n) for n in ("command", name)]
            held = (
                f"column {columns[0]!r} is named as both"
                if columns[0] == columns[1]
                else f"columns {columns[0]!r} and {columns[1]!r} hold the same signal"
                + (", sample by sample" if exactly else " up to noise")
            )
            so = ", so that S would be 1 at every line" if name == "injection" else ""
            text = (
                f"command and {name}: {held}, and a controller that is at work adds its own to the {name}{so}; name "
                f"the column that holds the controller's output together with the {name}, or leave the command out"
            )
            return [Finding("identical", view.recording, f"command or {name}", None, None, text, "contradiction")]
    return []


def _copies(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether a channel (samples,) is another one times a factor, besides its mean."""
    one, other = one - one.mean(), other - other.mean()
    power = float(other @ other)
    if not power or not np.ptp(one):
        return False
    return bool(np.abs(one - one @ other / power * other).max() <= SAME * np.ptp(one))


def _same_at_lines(view: View, name: str) -> bool:
    """Whether the command is another channel times a factor, and hardly later, at all lines that this one drives."""
    power = (np.abs(view.lines.parts[name]) ** 2).mean(axis=0)
    driven = np.flatnonzero(power > DRIVEN * power.max(initial=0.0))
    if not driven.size or view.lines.frequency[driven[-1]] < APART * view.lines.frequency[driven[0]]:
        return False
    lines = view.lines.at(driven)
    out, source = lines.parts["command"], lines.parts[name]
    found = fit(out, [source], lines.frequency, view.rate, lines.periodic)
    if found is None or abs(found.delay[0]) * view.rate > LATE:
        return False
    if lines.periodic:
        out, source = out.mean(axis=0)[None], source.mean(axis=0)[None]
    left = out - found.gain[0] * np.exp(-2j * np.pi * lines.frequency * found.delay[0]) * source
    whole = (np.abs(out) ** 2).sum(axis=0)
    return bool(whole.all() and ((np.abs(left) ** 2).sum(axis=0) / whole).mean() <= LEFT**2)


def _open(view: View) -> bool:
    """Whether nothing controls the rotor, as far as is stated, so that a command is what is injected."""
    if view.rig is not None and not view.rig.controlled:
        return True
    if view.gains is not None:
        z = np.exp(1j * np.pi * (np.arange(POINTS) + 0.5) / POINTS)
        return not np.abs(controller_response(view.gains, z, 1 / view.rate)).any()
    # What a spring holds may be driven without a controller; what the magnets alone would let fall may not.
    return view.rig is not None and view.rig.support_stiffness + linearise(force_law(view.rig))[1] > 0
