"""What no rotor and no loop can do: move farther than its clearance, or suppress disturbances at every frequency."""

import numpy as np
from scipy import stats

from estimation.frequency_response import pooled_variance
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.view import View

FREE = 1.05  # of the clearance to both sides
LEVEL = 4.0  # standard errors
SETTLED = 0.25  # |S - S of the highest lines| from which the sensitivity has reached its end
LEAST_LINES = 8
PARTS, APART = 8, 0.3  # of a record, for a drift; of the command's standard deviation
CENTRED, MOVED = 0.04, 1.0  # offsets that count: of the gap, and of the motion's standard deviation


def clearance(view: View) -> list[Finding]:
    """The displacement within the rig's clearance: its range cannot be larger than the way from stop to stop."""
    if view.rig is None or "displacement" not in view.recorded:
        return []
    y, free = view.channels["displacement"], view.rig.clearance
    column = view.columns.get("displacement")
    way, reach = float(np.ptp(y)), float(np.abs(y).max())
    if way > 2 * FREE * free:
        text = (
            f"displacement: it moves over {way:.4g} m, and the rig's clearance leaves {2 * free:.4g} m, "
            f"{way / (2 * free):.3g} times less; check the scale (the unit) of column {column!r}"
        )
        return [Finding("clearance", view.recording, "displacement", way / (2 * free), None, text, "contradiction")]
    if reach > FREE * free:
        text = (
            f"displacement: its mean is {y.mean():.4g} m, beyond the clearance of {free:.4g} m; check the offset of "
            f"column {column!r}"
        )
        return [Finding("clearance", view.recording, "displacement", float(y.mean()), None, text, "wiring")]
    return []


def balance(view: View) -> list[Finding]:
    """Mean displacement and mean current of a pair of magnets: at rest the current's pull balances the stiffness.

    Only for recordings that never repeat, whose operating point enters the comparison with a simulation.
    """
    rig = view.rig
    if (
        view.periodic
        or rig is None
        or "pair" not in rig.capabilities
        or not {"displacement", "current"} <= view.recorded
    ):
        return []
    gain, stiffness = linearise(force_law(rig))
    y, i = view.channels["displacement"], view.channels["current"]
    off = y - gain * i / (stiffness + rig.support_stiffness)
    parts = np.array([part.mean() for part in np.array_split(off, PARTS)])
    level, spread = float(off.mean()), float(y.std())
    drift, _, _, _, se = stats.linregress(np.linspace(-0.5, 0.5, PARTS), parts)
    found = []
    said = ""
    if abs(level) > max(CENTRED * rig.gap, MOVED * spread):
        said, size = f"do not balance, by {level:.3g} m", level
    elif abs(drift) > max(0.5 * CENTRED * rig.gap, LEVEL * se):
        said, size = f"drift apart, by {drift:.3g} m over the recording", float(drift)
    if said:
        text = (
            f"displacement or current: their means ({y.mean():.3g} m, {i.mean():.3g} A) {said}; check the offsets of "
            "both columns; or an effect (eccentricity, actuator_offset) or a static load: run `maglev diagnose`"
        )
        found.append(Finding("balance", view.recording, "displacement or current", size, None, text, "effect"))
    if "command" in view.recorded:
        u = view.channels["command"]
        apart = float(i.mean() - u.mean())
        if abs(apart) > max(APART * float(u.std()), 5 * rig.noise.current):
            text = (
                f"command or current: their means are {u.mean():.3g} and {i.mean():.3g} A, and an amplifier keeps the "
                "mean; check the offsets of both columns"
            )
            found.append(Finding("balance", view.recording, "command or current", apart, None, text, "wiring"))
    return found


def sensitivity(view: View) -> list[Finding]:
    """Command per injection: far above the loop's bandwidth it is 1, and its peak is at least 1.

    The integral of ln|S| over all frequencies is zero or positive for every loop whose gain falls off like a rotor's
    (Bode; Freudenberg and Looze 1985 with unstable poles). So where |S| is below 1 at all measured lines, and has
    come to rest at the highest of them, command and injection have different scales.
    """
    if not view.periodic or not {"command", "injection"} <= view.recorded:
        return []
    lines = view.lines.at(view.place("current"))
    if lines.frequency.size < LEAST_LINES:
        return []
    u, j = lines.parts["command"], lines.parts["injection"]
    if not np.abs(j.mean(axis=0)).all():
        return []
    s = u.mean(axis=0) / j.mean(axis=0)
    rest = (u - s * j).var(axis=0, ddof=1) / len(u) / np.abs(j.mean(axis=0)) ** 2
    error = np.sqrt(pooled_variance(rest))
    size = np.abs(s)
    peak = float((size + LEVEL * error).max())
    if peak >= 1:
        return []
    top = slice(-max(LEAST_LINES // 2, s.size // 10), None)
    end = float(np.mean(size[top]))
    text = (
        f"command or injection: the peak of |S| over {s.size} lines is {size.max():.3g}, below 1, which no loop with a "
        "rotor can have (Bode's integral)"
    )
    if np.abs(s[top] - s[top].mean()).max() < SETTLED * end:
        text += f"; at {lines.frequency[-1]:.4g} Hz it rests at {end:.3g} and should be 1; check both scales"
        return [Finding("sensitivity", view.recording, "command or injection", float(size.max()), None, text,
                        "contradiction")]  # fmt: skip
    text = (
        f"injection: |S| stays below 1 ({size.max():.3g} at most) up to {lines.frequency[-1]:.4g} Hz: its peak lies "
        "higher, so the peak and the zone that are printed are too good; inject at higher frequencies"
    )
    return [Finding("sensitivity", view.recording, "injection", float(size.max()), None, text, "quality")]
