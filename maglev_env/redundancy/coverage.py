"""What no comparison of a recording covers, said so that nobody takes silence for a check."""

from collections.abc import Sequence

from maglev_env.loop.gains import reads_current
from maglev_env.redundancy.controller import cut_off
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import LEVEL, Row
from maglev_env.redundancy.view import View

DRIVEN = "injection to command"  # the row of what drives the loop
BETWEEN = "time between force and displacement"
CHANNELS = ("displacement", "force", "current", "command")  # whose scales enter results


def uncovered(view: View, rows: Sequence[Row]) -> list[Finding]:
    """Scales that no row holds, in one finding."""
    if "voltage" in view.channels:  # a coil's recording, of which only the gap is asked
        return []
    seen = {name for row in rows for name in row.powers}
    free = [name for name in CHANNELS if name in view.recorded and name not in seen]
    if "force" in free and view.excitations and all(e.periodic and e.at != "force" for e in view.excitations):
        free.remove("force")  # nothing but noise is in it along this axis
    if view.gains is not None and view.rig is not None and view.rig.controlled and "gains" not in seen:
        free.append("gains")
    if "mass" not in seen and view.mass is not None:
        free.append("mass")
    if view.rig is None and "force" in view.recorded:
        free += [_between(view, rows), "AC coupling of the displacement"]  # an integrating controller looks alike
    late = [row.against for row in rows if row.code == DRIVEN and row.delay is None]
    free += [f"time of {drive}" for drive in late]
    if not free:
        return []
    advice = []
    if "mass" in free or "displacement" in free:
        advice.append("record the force with lines above the resonance" if "force" not in view.recorded
                      else "excite at higher frequencies, where the mass dominates")  # fmt: skip
    if "force" in free:
        advice.append("state the excitation's amplitude")
    if "command" in free or "current" in free:
        advice.append(
            "name the rig and its gains" if view.rig is None else "record command and current at the control rate"
        )
    if "gains" in free and view.rig is not None:
        inputs = ["displacement", *(["current"] if reads_current(view.gains, 1 / view.rig.control_rate) else [])]
        missing = [name for name in ("command", *inputs) if name not in view.recorded]
        missing += [] if view.known_drive else ["what is injected"]
        if not missing and ("command" in view.railed or cut_off(view.channels["command"])):
            advice.append("the command reaches a limit that the controller does not state: state its limit, such as "
                          'controller = { form = "pid", ..., limit = [-1.0, 1.0] }')  # fmt: skip
        else:
            advice.append(f"record {' and '.join(missing) or 'every channel'} at the control rate")
    if late:
        advice.append("excite more than one line")
    if any(name.startswith(BETWEEN) for name in free) and not any("name the rig" in a for a in advice):
        advice.append("name the rig and its gains")
    text = f"not checkable here: {', '.join(free)}; {', '.join(advice)}"
    return [Finding("coverage", view.recording, " or ".join(free), None, None, text, "not checkable")]


def _between(view: View, rows: Sequence[Row]) -> str:
    """The time that nothing contradicts where no rig is known: all, or what an unknown controller may look like."""
    known = [r.delay_tolerance + LEVEL * r.delay_se for r in rows if r.code == "newton force" and r.delay is not None]
    return f"{BETWEEN} below {view.rate * known[0]:.2g} samples" if known else BETWEEN
