"""One rig, many recordings: stiffness, damping and actuator gain by one fit of all of them, beside the nominal rig.

Recordings of any shape take part: periodic ones by their lines, others as `open_record` compares them. What is known of
the nominal rig within a tolerance stays a prior, so a scale that no recording tells (of mass, gain and stiffness
together, where no force is recorded) has the interval that the tolerances leave.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import stats

from estimation.apparent_gain import ApparentGain
from maglev_env.loop.effect import effect_value
from maglev_env.rig.rig import Rig
from sim2real.axes_apart import along_both
from sim2real.coefficients import (
    UNITS,
    Coefficient,
    across_recordings,
    change_at,
    coefficients_of,
    forced,
    misfit,
    nominal_coefficient,
    overstated,
)
from sim2real.compared.problem import Problem, assemble
from sim2real.gain_over_frequency import Mechanics, apparent_gain
from sim2real.late_current import in_words, lateness, without_current
from sim2real.pooled_fit import fitted
from sim2real.recorded.at_rest.static_evidence import AT_REST, StaticEstimate, drift_in_words, static_of
from sim2real.recorded.open_record import OpenRecord, along_instrument
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit
from sim2real.second_body import BODY, SecondBody, body_in_words, second_body_of, with_second_body
from sim2real.words import quantity

CLEAR = 3.0  # standard errors, for one coefficient alone, from which a recording disagrees with all of them
SURELY = 2.0  # standard errors above the nominal damping from which an identified one counts as damping


@dataclass(frozen=True)
class Pooled:
    """A pooled estimate.

    Attributes:
        coefficients: What was identified.
        misfit: Mean square of the whitened residual over its expectation; 1 where the model explains everything.
        disagreements: By coefficient, sentences about recordings that disagree with all of them together.
        of_each: Recording -> its own coefficients, where there are several recordings.
        held_out: Recordings that were not used, because their role is "holdout".
        notes: What was assumed.
        contradictions: Sentences about what motion says against means and weight.
        gain: The actuator's gain over frequency; None where no current was measured.
        second_body: What one mass lacks; None where none was fitted.
        moving: Whether motion is told; else all is by means and weight.
    """

    coefficients: tuple[Coefficient, ...]
    misfit: float
    disagreements: Mapping[str, tuple[str, ...]]
    of_each: dict[str, tuple[Coefficient, ...]]
    held_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    contradictions: tuple[str, ...] = ()
    gain: ApparentGain | None = None
    second_body: SecondBody | None = None
    moving: bool = True


def pooled(
    records: Sequence[Record | OpenRecord],
    progress: Callable[[str], None] = lambda text: None,
    resting: Sequence[Record | OpenRecord] | None = None,
) -> Pooled:
    """Fit one rig to all records in closed loop.

    Args:
        records: Of one campaign.
        progress: Called with each step.
        resting: Those whose means at rest count; None: the same. A record may tell these although its motion is not
            simulated.

    Raises:
        ValueError: The rotor touches down in the simulation with the nominal parameters.
    """
    rig = records[0].nominal
    progress("all recordings")
    static = static_of(rig, [r.rests for r in (records if resting is None else resting)])
    problem, fit, others = fitted(records, rest=False)
    if (late := lateness(problem, fit)) is not None:
        records = without_current(records)
        problem, fit, others = fitted(records, rest=False)
    if (bent := with_second_body(problem, fit)) is not None:
        progress("a second body")
        problem, fit, others = fitted(records, bent)
    used, noisy, alone = _told_by_drives(records, fit, others)
    if noisy:
        problem, fit, others = fitted(used, fit, rest=False)
    whole, differ = along_both(rig, problem, fit, others)
    of_each, apart, contradictions = {}, {}, []
    if static is not None:
        of_each[AT_REST] = resting = at_rest(rig, static)
        contradictions = _contradictions(whole, resting)
        if not contradictions:
            joined = fitted(used, fit, rest=True)
            joint = coefficients_of(rig, *joined)
            contradictions = _pulled(joint, resting)
            if not contradictions:
                (problem, fit, others), whole, alone = joined, joint, {}  # those begin at another fit
    if len(records) > 1:
        for record in records:
            progress(record.name)
            of_each[record.name], _ = along_both(rig, *(alone.get(record.name) or fitted([record], fit)))
        each = {c.name: [own for r in records for own in of_each[r.name] if own.name == c.name] for c in whole}
        for record in records:
            for name, text in _disagreements(record.name, of_each[record.name], whole).items():
                apart.setdefault(name, []).append(text)
        whole = tuple(across_recordings(c, each[c.name]) if c.name in apart else c for c in whole)
        apart = {name: tuple(texts) for name, texts in apart.items() if _scatter(each[name])}
    if contradictions:
        whole = _reaching(whole, of_each[AT_REST])
    told_late = None if late is None else in_words(late)
    drifted = None if static is None else drift_in_words(static)
    body = second_body_of(fit)
    said = None if body is None else body_in_words(body)
    without = without_stiffness(rig)
    notes = tuple(filter(None, [noisy, without, told_late, said, *differ, exact_mass(records), drifted]))
    progress("gain over frequency")
    over = _over_frequency(rig, static, whole, problem, fit)
    return Pooled(
        whole,
        misfit(fit),
        apart,
        of_each,
        notes=notes,
        contradictions=tuple(contradictions),
        gain=over,
        second_body=body,
    )


def _told_by_drives(
    records: Sequence[Record | OpenRecord], fit: Fit, others: Sequence[Fit]
) -> tuple[Sequence[Record | OpenRecord], str | None, dict[str, tuple[Problem, Fit, list[Fit]]]]:
    """The records that are fitted together, a sentence on those that are left out, and the fit of each alone, by name,
    where it was asked for and begins at this fit.

    Where the fit seems to tell more of the gain than it does, because of noise in the measured drives, those records
    stay which alone tell as much as they seem to; all of them where none does.
    """
    if len(records) < 2 or not any(map(along_instrument, records)) or not overstated(fit, others):
        return records, None, {}
    alone = {r.name: fitted([r], fit, rest=False) for r in records}
    clear = [r for r in records if not overstated(*alone[r.name][1:])]
    if not clear or len(clear) == len(records):
        return records, None, alone
    noisy = ", ".join(r.name for r in records if r not in clear)
    why = "noise in what drives it tells more than what excites it"
    return clear, f"{noisy}: not in the estimate of all, because {why}", {}


def without_stiffness(rig: Rig) -> str | None:
    """A sentence where the rig states nothing that a stiffness could be a change of, else None."""
    if not rig.controlled or rig.support_stiffness or nominal_coefficient(rig, "negative_stiffness"):
        return None
    return (
        "the rig has neither negative_stiffness nor support_stiffness, so no stiffness is fitted: where a cable or a "
        "spring pulls, state support_stiffness roughly"
    )


def exact_mass(records: Sequence[Record | OpenRecord]) -> str | None:
    """A sentence where the scale of gain and stiffness rests on a mass of which no tolerance is stated, else None."""
    return None if forced(records) else exact_mass_in_words(records[0].nominal)


def exact_mass_in_words(rig: Rig) -> str | None:
    """The same where no force is recorded."""
    if "mass" in rig.tolerance:
        return None
    return (
        f"no force is recorded and [tolerance] states none of the mass, so {rig.mass:.4g} kg count as exact: with 1 % "
        "more mass, gain and stiffness are 1 % more"
    )


def _over_frequency(
    rig: Rig, static: StaticEstimate | None, whole: Sequence[Coefficient], problem: Problem, fit: Fit
) -> ApparentGain | None:
    """The gain over frequency, with the stiffness at rest where that is told, else as identified, else nominal; None
    beside a second body, whose motion would count as gain."""
    if not rig.controlled or BODY in fit.hypothesis.effects:
        return None
    told = {c.name: c for c in whole if c.identified}
    if "damping" in told and told["damping"].apart < SURELY:
        del told["damping"]  # a force that comes late acts as a negative one, and is to be seen here
    point = fit.hypothesis.point(fit.u)
    effects = {name: values for name, values in point.effects.items() if name not in UNITS or name in told}
    source = "identified" if "negative_stiffness" in told else "nominal"
    if static is not None and static.stiffness is not None:
        own = {c.name: c for c in at_rest(rig, static)}
        effects |= {name: {**effects.get(name, {}), "change": change_at(rig, c)} for name, c in own.items()}
        told, source = told | own, AT_REST

    def of(name: str) -> tuple[float, float]:
        """Value and standard error."""
        nominal, known = nominal_coefficient(rig, name), told.get(name)
        return (nominal, abs(nominal) * rig.tolerance.get(name, 0.0)) if known is None else (known.value, known.se)

    (pull, pull_se), (held, held_se), (damping, damping_se) = map(
        of, ("negative_stiffness", "support_stiffness", "damping")
    )
    known = Mechanics(
        rig.mass * (1 + effect_value(rig.effects, "mass")),
        rig.tolerance.get("mass", 0.0),
        pull + held,
        float(np.hypot(pull_se, held_se)),
        damping,
        damping_se,
        source,
    )
    at = replace(point, effects=effects)
    # The channels' errors about none, as the gain in bands is found with the drive as it was read.
    records, used = [p.record for p in problem.parts], [p.used for p in problem.parts]
    plain = assemble(records, used, at, rest=False, for_estimate=problem.for_estimate)
    return apparent_gain(plain, at, of("actuator_gain")[0], known)


def at_rest(rig: Rig, static: StaticEstimate) -> tuple[Coefficient, ...]:
    """What the means and the weight say."""
    names = ("actuator_gain", "negative_stiffness")
    sd = np.sqrt(np.diag(static.covariance))
    return tuple(
        Coefficient(name, UNITS[name], float(value), float(spread), nominal_coefficient(rig, name), True)
        for name, value, spread in zip(names, static.values, sd, strict=False)
    )


def _contradictions(moving: Sequence[Coefficient], resting: Sequence[Coefficient]) -> list[str]:
    """A sentence for each coefficient by motion that is far from what means and weight say."""
    found, at_rest = [], {c.name: c for c in resting}
    for c in moving:
        if (other := at_rest.get(c.name)) is None or not c.identified:
            continue
        apart = abs(c.value - other.value) / float(np.hypot(c.se, other.se))
        if apart > CLEAR:
            found.append(
                f"{c.name.replace('_', ' ')} by motion is {quantity(c.value, c.se, c.unit)}, and by means and weight "
                f"{quantity(other.value, other.se, c.unit)}: {apart:.1f} standard errors apart; check offset, scale "
                "and timing of the current, and the force law"
            )
    return found


def _pulled(joint: Sequence[Coefficient], resting: Sequence[Coefficient]) -> list[str]:
    """A sentence for each coefficient at rest that motion pulls away, which may tell too little to contradict alone."""
    found = []
    for own in resting:
        c = next(c for c in joint if c.name == own.name)
        apart = abs(c.value - own.value) / own.se
        if apart > CLEAR:
            found.append(
                f"{own.name.replace('_', ' ')} by means and weight is {quantity(own.value, own.se, own.unit)}, and "
                f"motion pulls it {apart:.1f} standard errors away, to {c.value:.4g}; check offset, scale and timing "
                "of the current, and the force law"
            )
    return found


def _reaching(moving: Sequence[Coefficient], resting: Sequence[Coefficient]) -> tuple[Coefficient, ...]:
    """Coefficients whose intervals reach the contradicting ones of the mass at rest.

    What motion has wrong is not only in these two: as many standard errors may be in what rest does not tell.
    """
    reach, rest = float(stats.norm.isf(0.025)), {c.name: c.value for c in resting}
    off = {c.name: abs(rest[c.name] - c.value) / reach for c in moving if c.name in rest}
    most = max((off[c.name] / c.se for c in moving if c.name in off and c.identified), default=0.0)
    return tuple(
        c.with_error(float(np.hypot(c.se, off[c.name])) if c.name in off else c.se * max(most, 1.0)) for c in moving
    )


def _scatter(each: Sequence[Coefficient]) -> bool:
    """Whether recordings differ from each other in a coefficient, and not from the fit to all of them alone."""
    told = [own for own in each if own.identified and own.se > 0]
    limit = float(stats.norm.isf(stats.norm.sf(CLEAR) / max(len(told) * (len(told) - 1) // 2, 1)))
    return any(abs(a.value - b.value) > limit * np.hypot(a.se, b.se) for a, b in combinations(told, 2))


def _disagreements(name: str, own: Sequence[Coefficient], whole: Sequence[Coefficient]) -> dict[str, str]:
    """Coefficients of one recording that are far from those of all together, with a sentence for each."""
    limit = float(stats.norm.isf(stats.norm.sf(CLEAR) / len(own)))
    found, of_all = {}, {c.name: c for c in whole}
    for a in own:
        b = of_all[a.name]
        # The whole contains the recording, so their difference varies by what the others add, at most as the recording
        # does alone. Only a misfit leaves the whole less sure than that, and the misfit may be this disagreement.
        of_both = np.sqrt(max(a.se**2 - b.se**2, 0.25 * a.se**2)) if b.se < a.se else a.se
        apart = abs(a.value - b.value)
        if a.identified and b.identified and of_both > 0 and apart > limit * of_both:
            # The error of the whole is in the table, widened by just these disagreements.
            found[a.name] = (
                f"{name}: {a.name.replace('_', ' ')} {quantity(a.value, a.se, a.unit)}, and "
                f"{quantity(b.value, None, b.unit)} of all recordings together: apart by "
                f"{quantity(apart, float(of_both), a.unit)}, {apart / of_both:.1f} standard errors"
            )
    return found
