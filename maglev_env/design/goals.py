"""The goal of a rig: that of its file, one by name, or requirements read from a file or a text."""

from dataclasses import replace
from pathlib import Path

from maglev_env.fields import toml_text
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.goal import ENGINEER, MATCH, NAMED, Goal, Requirement, parse_goal
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.rig.target import default_band
from maglev_env.units import STANDARD_GRAVITY

# docs/goals.md argues every number. Limits are in proportion to the rig, so that each preset has its own.
LEAST_PHASE, LEAST_GAIN, ZONE_A = 30.0, 2.0, 3.0  # degrees, factor, peak |S| of ISO 14839-3
COMPLIANCE_SHARE = 0.1  # of the clearance, by which the load moves the rotor at the worst frequency
SHOCK, SHOCK_SHARE = 0.005, 0.3  # s for which the load acts as an impulse; share of the clearance, as in ISO 14839-2
RECOVERY, LIFT_OFF, LIFT_OFF_SHARE = 0.03, 0.03, 0.5  # s, s, share of the clearance from which it lifts off
TIMES_OF = 90.0  # Hz, the centre of the target band for which both times are stated
HUNG = 0.25  # of the weight, where a single magnet carries it: what pulls one way alone cannot hold it in any posture
# An electromagnet cannot push: what an impulse throws toward it flies v^2 / 2g by itself, so far of the limit at most.
THROWN = 0.5
NOISE_SHARE = 0.15  # of the bias current, so that four times the rms stays clear of it; or of the current limit


def goal_of(rig: Rig) -> Goal | None:
    """The goal that a rig's [target] states; None stands for `match`.

    Raises:
        ValueError: It is judged on rigs within tolerance, and the rig has no [tolerance].
    """
    text = rig.target.goal.strip()
    if text == MATCH:
        return None
    goal = engineer(rig) if text == ENGINEER else parse_goal(text)
    if goal.rigs and not rig.tolerance:
        raise ValueError(f"goal: worst of {goal.rigs} rigs: rig {rig.name} has no [tolerance] to draw them within")
    return goal


def with_goal(rig: Rig, source: str | None) -> Rig:
    """The rig with a goal, whose limits stay when the rig's parameters are changed or drawn.

    Args:
        rig: the rig.
        source: a name of NAMED, the path of a text file, or the requirements themselves; None: the rig's own.

    Raises:
        ValueError: The text is not understood.
        OSError: The file cannot be read.
    """
    stated = rig if source is None else replace(rig, target=replace(rig.target, goal=goal_text(source)))
    goal = goal_of(stated)
    return replace(stated, target=replace(stated.target, goal=goal.text if goal else MATCH))


def engineer(rig: Rig) -> Goal:
    """What an engineer of a rotor that carries a body's blood asks for, in proportion to the rig; see docs/goals.md.

    The load is the rotor's weight; a quarter of it where it hangs below a single magnet; and where magnets cannot carry
    it, so that something else does, the force that the bias current stands for. Times are stated for the target band of
    `hmb_free`, and longer in proportion where the rig's lies lower.

    Raises:
        ValueError: The rig has no magnets.
    """
    if not rig.controlled:
        raise ValueError(f"goal {ENGINEER}: rig {rig.name} has no controlled magnet: there are no gains to judge")
    own = axis_rig(rig, 0)
    weight, magnets = own.mass * STANDARD_GRAVITY, linearise(force_law(own))[0] * own.bias_current
    borne = weight if "pair" in own.capabilities else HUNG * weight
    load = min(borne, magnets or borne)
    low, high = rig.target.band or default_band(rig.control_rate)
    slower = TIMES_OF / ((low + high) / 2)

    def limit(name: str, value: float, at: float | None = None) -> Requirement:
        return Requirement(name, float(f"{value:.3g}"), at and float(f"{at:.3g}"))

    shock, carried = load * SHOCK * slower, load == borne and not own.support_stiffness
    if carried and own.magnet == "electromagnet":
        shock = min(shock, own.mass * (2 * THROWN * SHOCK_SHARE * own.clearance * STANDARD_GRAVITY) ** 0.5)
    requirements = [
        limit("peak_sensitivity", ZONE_A),
        limit("phase_margin", LEAST_PHASE),
        limit("gain_margin", LEAST_GAIN),
        limit("compliance", COMPLIANCE_SHARE * own.clearance / load),
        limit("noise_current", NOISE_SHARE * (own.bias_current or own.target.current_limit)),
        limit("impulse_displacement", SHOCK_SHARE * own.clearance, shock),
        limit("recovery_time", RECOVERY * slower, load),
    ]
    if carried:
        requirements.append(limit("lift_off_time", LIFT_OFF * slower, LIFT_OFF_SHARE * own.clearance))
    return Goal(tuple(requirements), requirements[3])


def goal_text(text: str) -> str:
    """The text of a goal itself, or that of the file it names.

    Raises:
        ValueError: It is neither a goal nor a file.
        OSError: The file cannot be read.
    """
    path = Path(text)
    if text.strip() in ("", *NAMED) or set(text) & set("<>=") or text.strip().startswith("best "):
        return text
    if path.exists():
        return toml_text(path, "goal")
    raise ValueError(
        f"--goal {text!r:.80} is neither a goal ({', '.join(NAMED)}), a file, nor requirements such as "
        "'peak_sensitivity <= 3, best compliance near 20e-6'"
    )
