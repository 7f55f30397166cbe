"""The next experiment on a real rig: from the recordings so far to gains, a diagnosing recording, or a stop."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from maglev_env.design.defaults import with_defaults
from maglev_env.loop.gains import PidGains, gain_values
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import gain_box
from maglev_env.task.task import Task, make_task
from tuning.campaign.advice import Advice, stopped
from tuning.campaign.candidates import predict
from tuning.campaign.carried import beside, carried
from tuning.campaign.disagreement import Disagreement
from tuning.campaign.farther import farther, in_words, lacking, names_of
from tuning.campaign.gain_set import GainSet, shown
from tuning.campaign.model import Model, event_current, model_of
from tuning.campaign.rig_fit import IdentifiedRig, fit_rig
from tuning.campaign.steps import asked_by_diagnosis, onward

CREST, FAR = 3.0, 2.0  # peak over rms of a recorded current; factor beyond it at which a user is told


def next_step(
    rig: Rig,
    sets: Sequence[GainSet],
    tuned: Sequence[str] | None = None,
    budget: int = 10,
    seed: int = 0,
    goal: str | None = None,
    diagnosis: Callable[[], Disagreement] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Advice:
    """Decide what to record next on a rig, or that it is time to stop.

    Args:
        rig: Nominal rig of one axis.
        sets: Recorded gain sets.
        tuned: Names of the tuned gains; None: kp, ki and kd, and where they cannot meet the goal, td too, in wider
            ranges where neither rig nor bounds state them.
        budget: Number of recordings in the sets, in all. Those with the role holdout do not count, nor do those that
            were left out, which may not have been made for tuning.
        seed: Seed of every choice.
        goal: What gains are judged by, see `design.goals.with_goal`; None: the rig's own.
        diagnosis: Diagnoses the campaign, where its recordings contradict the model.
        bounds: (low, high) of gains by name, instead of the rig's.

    Raises:
        ValueError: The rig has two axes or no controlled magnet, the sets differ in gains that are not tuned, or the
            goal is not understood.
    """
    bounds = dict(bounds or {})
    task, corners = tuning_task(rig, sets, names_of(sets, tuned), goal, bounds)
    good = [i for i, s in enumerate(sets) if s.failed is None]
    nothing: tuple[None, ...] = (None,) * len(sets)
    notes = tuple(f"{', '.join(s.files)}: {s.failed or s.untold}" for s in sets if s.failed or s.untold)
    notes += tuple(f"{one} (other recordings at the same gains held)" for s in sets for one in s.beside)
    if not good:
        failed = Advice(task, tuple(sets), nothing, nothing, None, notes=notes)
        if failed.recordings >= budget:
            return replace(failed, stop=f"the budget of {budget} recordings is used up, and none of them held")
        return _start(failed, with_defaults(rig).gains)
    if all(sets[i].untold for i in good):
        last = sets[good[-1]]
        untried = Advice(task, tuple(sets), nothing, nothing, None, notes=notes)
        return _designed(untried, last, last.untold or "", budget)
    held = [None if s.failed or s.untold else s for s in sets]
    told = [s for s in held if s]
    identified, found = fit_rig(task.rig, told), None
    if identified.contradicted and diagnosis:
        found = diagnosis()
        identified = _explained(task, told, identified, found)
    if identified.other_mass and (found is None or not identified.contradicted):
        notes = (
            f"the recordings look like those of another mass than the stated {task.rig.mass:.4g} kg, by more than its "
            "tolerance and that of the probe: weigh the rotor, and check the scales of force and displacement; gains "
            "are judged by the stated mass",
            *notes,
        )
    if identified.contradicted:
        notes = (
            f"the recordings contradict the rig's model: they miss it by {np.sqrt(identified.misfit):.2g} times what "
            "noise and 1 % of model error explain; gains are judged by the measured responses, and large signals "
            "(events, noise) by the nearest model"
            + (f". {found.sentence}" if found else "; `maglev diagnose` on this campaign says where and why"),
            *notes,
        )
    elif found and found.rig:
        notes = (f"{found.sentence} It is part of the rig by which gains are judged", *notes)
    if task.layout.goal and task.layout.goal.rigs:
        notes = (f"worst of {task.layout.goal.rigs} rigs: judged on what the recordings leave of this one rig", *notes)
    responses = carried(identified, told, seed)
    model = model_of(task, corners, identified, responses, told, seed)
    seen = tuple(s and shown(s, task.rig.target.band, task.rig.mass, seed) for s in held)
    rate = task.rig.control_rate
    own = [s and carried(identified, beside(s, told, rate), seed, responses.sharp) for s in held]
    claimed = tuple(s and predict(model, s.gains, r, s) for s, r in zip(held, own, strict=True))
    if responses.sharp.size:
        notes = (*notes, _sharp_in_words(responses.sharp))
    advice = Advice(task, tuple(sets), seen, claimed, identified, diagnosis=found, notes=notes)
    if advice.recordings >= budget:
        return _beyond_recorded(stopped(advice, f"the budget of {budget} recordings is used up"), model)
    if (asked := asked_by_diagnosis(advice, model, budget)) is not None:
        return asked
    found = onward(advice, model, seed, budget)
    if tuned is None and lacking(found):
        ranges = dict(zip(task.box.names, task.box.gains(corners).T, strict=True))
        names, wider = farther(rig, ranges, bounds)
        task, corners = tuning_task(rig, sets, names, goal, wider)
        wide = model_of(task, corners, identified, responses, told, seed)
        found = in_words(onward(replace(advice, task=task), wide, seed, budget), corners)
    return _beyond_recorded(found, model)


def tuning_task(
    rig: Rig,
    sets: Sequence[GainSet],
    tuned: Sequence[str],
    goal: str | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Task, np.ndarray]:
    """The task of a campaign, its box wide enough for what was recorded, and the ends of the asked box as actions.

    Raises:
        ValueError: As `next_step`.
    """
    if rig.axes != 1:
        raise ValueError(
            f"rig {rig.name} has two axes: a campaign is tuned one axis at a time; record one axis with a rig TOML of "
            "axes = 1"
        )
    if rig.gains is not None and not isinstance(rig.gains, PidGains):
        raise ValueError(
            f'rig {rig.name}: a campaign is tuned in PID gains, plain ones or of the form "pid", and its [gains] are '
            "of another form"
        )
    task = make_task(rig, tuned, bounds, goal=goal)
    if task.layout.goal and task.layout.goal.rigs:
        # There is one real rig, so only that one is simulated; the layout keeps the goal as it was asked for.
        alone = replace(task.layout.goal, rigs=0).text
        task = replace(task, rig=replace(task.rig, target=replace(task.rig.target, goal=alone)))
    if not sets:
        return task, np.array([[-1.0], [1.0]])
    box, first = task.box, sets[0]
    for name, value in gain_values(first.gains).items():
        other = next((s for s in sets if getattr(s.gains, name) != value), None)
        if other is not None and name not in box.names:
            raise ValueError(
                f"{first.files[0]} was recorded at {name} = {value:g}, {other.files[0]} at "
                f"{getattr(other.gains, name):g}: tune it too (--tune {name}), or leave one of them out"
            )
    tried = np.array([[getattr(s.gains, name) for name in box.names] for s in sets])
    ends = zip(np.minimum(box.low, tried.min(axis=0)), np.maximum(box.high, tried.max(axis=0)), strict=True)
    wide = gain_box(task.rig, box.names, dict(zip(box.names, ends, strict=True)))
    task = replace(task, rig=replace(task.rig, gains=first.gains), box=wide)
    return task, wide.actions(np.array([box.low, box.high]))


def _sharp_in_words(frequencies: np.ndarray) -> str:
    """A note on lines where the measured plant changes sharply."""
    shown = ", ".join(f"{f:g}" for f in frequencies[:5]) + (" ..." if frequencies.size > 5 else "")
    return (
        f"the plant changes sharply at {shown} Hz, as at the resonance of a support or of a rotor that bends; between "
        "the lines |S| may be larger than at any of them: excite more lines there, and ask `maglev diagnose`"
    )


def _designed(advice: Advice, held: GainSet, why: str, budget: int) -> Advice:
    """The rig's protocol at gains that held, where what was recorded without a period does not tell enough."""
    if advice.recordings >= budget:
        return replace(advice, stop=f"the budget of {budget} recordings is used up, and they tell no margins: {why}")
    words = (
        f"these gains held, but what was recorded at them does not tell how far one may go ({why}); record the "
        "designed excitation below at the same gains"
    )
    return replace(advice, next=held.gains, why=words, kind="designed")


def _start(advice: Advice, preset: PidGains) -> Advice:
    if not advice.sets:
        return replace(advice, next=preset, kind="start", why="the rig's preset gains, from which tuning starts")
    if all(s.gains != preset for s in advice.sets):
        return replace(
            advice, next=preset, kind="start", why="nothing recorded so far held; these are the rig's preset gains"
        )
    return replace(
        advice,
        stop="nothing recorded so far held, the rig's preset gains among it: reduce the excitation, check scales and "
        "signs of the channels, and ask `maglev diagnose` how the rig differs from its model",
    )


def _beyond_recorded(advice: Advice, model: Model) -> Advice:
    """The advice, with a note where the events of the goal need far more current than any recording shows."""
    if advice.keep is None:
        return advice
    peak = event_current(model, advice.sets[advice.keep].gains)
    recorded = CREST * max((s.current_rms for s in model.recorded if s.current_rms > 0), default=np.inf)
    if peak is None or not peak > FAR * recorded:
        return advice
    goal = advice.task.layout.goal
    names = {"impulse": "an impulse", "step": "a step load", "lift_off": "lift-off"}
    what = ", ".join(names[kind] for kind in goal.events)
    words = (
        f"what is said of {what} is simulated, with currents of up to {peak:.2g} A; the recordings reach about "
        f"{recorded:.2g} A, and do not show what saturates beyond that: try it on the rig before relying on it"
    )
    only = tuple(r.name for r in goal.requirements if r.quantity.event not in (None, "hover"))
    claimed = list(advice.claimed)
    claimed[advice.keep] = replace(claimed[advice.keep], simulated=only)
    return replace(advice, claimed=tuple(claimed), notes=(*advice.notes, words))


def _explained(task: Task, told: Sequence[GainSet], identified: IdentifiedRig, found: Disagreement) -> IdentifiedRig:
    """The rig fitted anew with the effects that the diagnosis names, where the recordings then contradict it less."""
    if found.rig is None:
        return identified
    named = replace(found.rig, gains=task.rig.gains, target=task.rig.target, protocol=task.rig.protocol)
    again = fit_rig(named, told)
    return again if again.misfit < identified.misfit else identified
