"""A command that is what was injected, or the reference, sample by sample: one signal was recorded under two names."""

import numpy as np

from maglev_env.loop.gains import controller_response
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.view import View

SAME = 1e-6  # of a channel's range: what digits of a file leave between copies
POINTS = 32  # of the unit circle, at which a controller that does nothing is nothing


def alike(view: View) -> list[Finding]:
    """The command as a copy of the injection or reference, which no loop that is closed has.

    Sensitivity, margins and gains that follow from it would be those of no loop at all: abs(S) = 1 at every line.
    """
    if "command" not in view.recorded or _open(view):
        return []
    for name in ("injection", "reference"):
        if name in view.recorded and _copies(view.channels["command"], view.channels[name]):
            columns = [view.columns.get(n, n) for n in ("command", name)]
            held = (
                f"column {columns[0]!r} is named as both"
                if columns[0] == columns[1]
                else f"columns {columns[0]!r} and {columns[1]!r} hold the same signal, sample by sample"
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


def _open(view: View) -> bool:
    """Whether nothing controls the rotor, as far as is stated, so that a command is what is injected."""
    if view.rig is not None and not view.rig.controlled:
        return True
    if view.gains is not None:
        z = np.exp(1j * np.pi * (np.arange(POINTS) + 0.5) / POINTS)
        return not np.abs(controller_response(view.gains, z, 1 / view.rate)).any()
    # What a spring holds may be driven without a controller; what the magnets alone would let fall may not.
    return view.rig is not None and view.rig.support_stiffness + linearise(force_law(view.rig))[1] > 0
