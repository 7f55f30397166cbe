"""Campaigns worth recording: the rig's own SPHS recording, and the larger set that a diagnosis needs."""

from dataclasses import dataclass, replace

import numpy as np

from estimation.multisine.sphs import odd_lines
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import Effects
from maglev_env.loop.gains import Controllers, PidGains, of_axis, with_gains
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import Rig, axis_rig

DIAGNOSIS_PERIODS = 8
OFFSET_SHARE = 0.05  # of the gap
_GROUP = 5  # odd lines: three for the force, one for the injection, one left out to detect odd distortion


@dataclass(frozen=True)
class PlannedRecording:
    """A named experiment of a campaign; role "fit" or "holdout" (kept for judging only)."""

    name: str
    role: str
    experiment: Experiment


def sphs_campaign(rig: Rig, gains: Controllers, effects: Effects, seed: int) -> tuple[PlannedRecording, ...]:
    """One recording with the rig's own protocol; on an x-y rig a second one with the force turned by 90 degrees.

    Without the second one the eight coefficients of x and y cannot be separated.
    """
    run1 = protocol_experiment(rig, gains, effects, seed)
    if rig.axes == 1:
        return (PlannedRecording("run1", "fit", run1),)
    turned = replace(run1, excitations=_turned(run1.excitations), seed=(seed, 1))
    return PlannedRecording("run1", "fit", run1), PlannedRecording("run2", "fit", turned)


def _turned(excitations: tuple[Excitation, ...]) -> tuple[Excitation, ...]:
    """The excitations with the forces turned by 90 degrees."""
    return tuple(replace(e, direction=e.direction + 90.0) if e.at == "force" else e for e in excitations)


def diagnosis_campaign(rig: Rig, gains: Controllers, effects: Effects, seed: int) -> tuple[PlannedRecording, ...]:
    """Odd random-phase multisines with detection lines, 8 periods each after a first one.

    The set has two amplitudes and two realisations; where a controller allows it, a second gain set and a static
    offset; on an x-y rig one recording with the force turned by 90 degrees; and one more realisation as the holdout.

    Raises:
        ValueError: The rig's protocol excites no force from which fundamental, range and amplitude could be taken.
    """
    if rig.protocol is None or not lines_at(rig.protocol.excitations, "force").size:
        raise ValueError(f"rig {rig.name}: the diagnosis campaign needs a [protocol] with an excitation at the force")
    rng = np.random.default_rng(seed)
    force, injection = _diagnosis_lines(rig, rng)
    pushing = next(e for e in rig.protocol.excitations if e.at == "force")
    own = [axis_rig(rig, axis).protocol for axis in range(rig.axes)]
    injecting = [max((e.amplitude for e in p.excitations if e.at == "current"), default=0.0) for p in own if p]

    def experiment(realisation: int, scale: float = 1.0, **changes: object) -> Experiment:
        fundamental = rig.protocol.excitations[0].fundamental
        drawn = {"kind": "multisine", "fundamental": fundamental, "seed": realisation}
        push = pushing.amplitude * scale
        parts = [Excitation(at="force", lines=force, amplitude=push, direction=pushing.direction, **drawn)]
        for axis in range(rig.axes if injection else 0):  # x and y take turns
            lines, size = injection[axis :: rig.axes], injecting[axis] * scale
            parts.append(Excitation(at="current", lines=lines, amplitude=size, direction=90.0 * axis, **drawn))
        base = Experiment(
            rig,
            gains,
            tuple(parts),
            DIAGNOSIS_PERIODS,
            rig.protocol.transient_periods,
            effects,
            seed=(seed, realisation),
        )
        return replace(base, **changes)

    plan = [("base", "fit", experiment(1)), ("phases", "fit", experiment(2)), ("half", "fit", experiment(3, 0.5))]
    if rig.controlled:
        plan.append(("gains", "fit", experiment(4, gains=_other_gains(rig, gains, effects))))
        plan.append(("offset", "fit", experiment(5, offset=OFFSET_SHARE * rig.gap)))
    if rig.axes == 2:
        run = experiment(7)
        plan.append(("turned", "fit", replace(run, excitations=_turned(run.excitations))))
    plan.append(("holdout", "holdout", experiment(6)))
    return tuple(PlannedRecording(*row) for row in plan)


def _diagnosis_lines(rig: Rig, rng: np.random.Generator) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Force and injection lines, all odd; in every group of five odd lines one is left out."""
    odd = odd_lines(1, int(lines_at(rig.protocol.excitations, "force").max()))
    force, injection = [], []
    for start in range(0, len(odd), _GROUP):
        group = rng.permutation(odd[start : start + _GROUP])
        injection.extend(group[:1])
        force.extend(group[2:])
    planned = lines_at(rig.protocol.excitations, "current")
    if not planned.size:
        return tuple(map(int, sorted(force))), ()
    beyond = planned[planned > odd[-1]] | 1
    return tuple(map(int, sorted(force))), tuple(map(int, np.unique(np.concatenate([injection, beyond]))))


def _other_gains(rig: Rig, gains: Controllers, effects: Effects) -> Controllers:
    """A second, clearly different gain set that keeps the simulated loop stable."""
    first = of_axis(gains, 0)
    if not isinstance(first, PidGains):
        raise ValueError("the diagnosis campaign varies PID gains; the rig has another controller")
    for kp, kd in ((0.8, 1.2), (1.0, 1.3), (1.0, 0.8), (1.1, 1.0)):
        other = with_gains(gains, kp=first.kp * kp, kd=first.kd * kd)
        e = protocol_experiment(rig, other, effects)
        if np.abs(closed_loop_poles(e)).max() < 1:
            return other
    raise ValueError("no second gain set near these gains is stable; choose gains with more margin")
