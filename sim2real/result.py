"""What a diagnosis found, and its JSON."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf
from typing import Any

import numpy as np

from maglev_env.loop.effect import EFFECTS
from maglev_env.presented import SHOWN, shown_as_table
from maglev_env.recordings.campaign import Campaign
from maglev_env.recordings.left_out import left_out_data
from maglev_env.rig.rig import Rig
from sim2real.advice.gain_choice import GainChoice
from sim2real.advice.proposal import Plan
from sim2real.coefficients import surplus
from sim2real.compared.commands_seen import by_count
from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.free.correction import Free
from sim2real.gap.leftover import Leftover
from sim2real.gap.locate import Where
from sim2real.gap.shrink import Gap, errors
from sim2real.gap.wrong_gain import WrongGain
from sim2real.gap.wrong_reading import WrongReading
from sim2real.judgement.belief import LEVEL
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.judge import Entry
from sim2real.judgement.meaning.untold_time import Late
from sim2real.judgement.tones.between_lines import BetweenLines
from sim2real.judgement.tones.tone_sizes import ToneSize
from sim2real.recorded.bursts import Bursts
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fit import NOT_TOLD, Fit
from sim2real.search.hypotheses import Coordinate
from sim2real.words import Fitted

SCHEMA = "maglev-diagnosis/1"
OFFSET = "actuator_offset"  # does not show where the mean of a suspended mass is no evidence

NOWHERE = 0.01  # standard deviations of the reciprocal of a form that may be infinite, below which it does nothing
TOLD = 2.0  # standard errors from which a form is told from the plain one


@dataclass(frozen=True)
class Diagnosis:
    """What a campaign shows about the nominal simulator.

    Attributes:
        verdict: "no_gap", "explained", "ambiguous" or "unexplained".
        cause: Names of the effects. For an ambiguous verdict, the alternatives that the campaign cannot distinguish,
            with "a+b" for two effects together; ("unknown",) for an unexplained one.
        where: Where the gap lies.
        which: Every hypothesis with its probability.
        indistinguishable: Sets of causes that the campaign cannot distinguish.
        next_experiments: The most useful next recordings, if they are needed.
        gap: How far the gap shrinks with the corrected rig.
        corrected: The point that closes the gap (calibration alone where no effect is named).
        campaign: The campaign of the recordings that were used.
        attribution: The fitted candidates.
        judged: The recordings or lines on which the gap is judged.
        choice: How the gap changes the choice of gains; None where no effect is named or the rig's protocol cannot
            score gains.
        seconds: Wall time, s.
        notes: What was assumed, or could not be determined; first why evidence was tempered, where it was.
        leftover: What the best partial explanation leaves, where the verdict is "unexplained".
        tempering: Reduced chi-square that the best explanation leaves, by which differences of evidence were divided;
            1 where it leaves no more than noise.
        free: What a free correction of a block adds where no effect explains the gap, or what is named leaves much.
        by_partial: The best partial explanation, where the corrected rig has it because it simulates the recordings
            better than calibration alone, or a free correction; None elsewhere.
        unseen: Effects that do not show in any recording: they act before the current that drives it, or in a mean that
            is no evidence of the weight, or look like the time between two readings that nobody states.
        likely: The hypotheses among which the truth is, by the fitted recordings alone, in 90 % of campaigns like those
            that taught the judge: of effects that show, each family of causes judged by what the others taught. None
            where no set of hypotheses is known to hold it as often.
        rareness: Share of the campaigns of a known cause that left as much unexplained, with their number; None unless
            the verdict is "unexplained".
        evidence: What the probabilities were computed from.
        late: The clear time between displacement and drive that this has taken up; None without one.
        misread: The scale or the time of a recorded channel that would explain as much; None without one.
        wrong_gain: The gain of the stated controller that would explain more than what is found; None without one.
        gap_of_named: How far the gap shrinks with what is named alone, where the corrected rig has a free correction
            beside it; None elsewhere.
        axis: Of a rig with two axes, the one of which alone this is the diagnosis, because no known effect of both
            explains the gap; None elsewhere.
        between: What lies between the lines of the drive and has no name; None unless the verdict is "unexplained".
        tones: Effect -> the tones that it would make, as they were seen, of those in any hypothesis.
        loud: Recording -> how many times as loud as the rig states is what the best explanation leaves, where that is
            much and nothing repeats that would tell noise from what an effect leaves.
        bursts: Of the recordings that differ from period to period at single moments.
        off_balance: What the mean of a recording lacks of carrying the weight, where that is much but no evidence, as a
            clause.
    """

    verdict: str
    cause: tuple[str, ...]
    where: Where
    which: tuple[Entry, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    next_experiments: Plan | None
    gap: Gap
    corrected: Point
    campaign: Campaign
    attribution: Attribution
    judged: Problem
    choice: GainChoice | None
    seconds: float
    notes: tuple[str, ...]
    leftover: Leftover | None = None
    tempering: float = 1.0
    free: Free | None = None
    by_partial: Candidate | None = None
    unseen: tuple[str, ...] = ()
    likely: tuple[Entry, ...] = ()
    rareness: tuple[float, int] | None = None
    evidence: Evidence | None = None
    late: Late | None = None
    misread: WrongReading | None = None
    wrong_gain: WrongGain | None = None
    gap_of_named: Gap | None = None
    off_balance: str | None = None
    axis: str | None = None
    between: BetweenLines | None = None
    loud: Mapping[str, float] = field(default_factory=dict)
    bursts: tuple[Bursts, ...] = ()
    tones: Mapping[str, tuple[ToneSize, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.campaign.folder.name}: {self.verdict}, {', '.join(self.cause) or 'no cause'}>"

    def _repr_html_(self) -> str:
        rows = [(" + ".join(e.effects), f"{100 * e.probability:.1f} %") for e in self.which[:SHOWN]]
        return shown_as_table(self, rows)

    @property
    def rig(self) -> Rig:
        """The nominal rig, which every diagnosed campaign names."""
        if self.campaign.rig is None:
            raise ValueError(f"{self.campaign.folder}: the campaign names no rig, so nothing can be corrected")
        return self.campaign.rig

    @property
    def corrected_by(self) -> str:
        """What the corrected rig has beside calibration."""
        if self.by_partial is not None:
            return "partial explanation"
        return "free correction" if self.corrected_freely else "what is named" if self.cause else "calibration"

    @property
    def corrected_freely(self) -> bool:
        """Whether the corrected rig has the free correction."""
        return self.free is not None and self.free.gained and self.by_partial is None

    @property
    def closing(self) -> Gap:
        """The gap of which what is named closes a share; where nothing is named, that of the corrected rig."""
        return self.gap_of_named or self.gap

    def to_json(self) -> dict[str, Any]:
        """The diagnosis as schema maglev-diagnosis/1, in SI units; None for what could not be determined.

        The closed fraction is that of `closing`, the corrected closed fraction that of the corrected rig.
        """
        which = [
            {
                "effects": list(e.effects),
                "probability": e.probability,
                "parameters": {}
                if e.candidate is None
                else fitted_parameters(self.attribution.candidates[e.candidate]),
                "explained_worst_group": e.explained_worst_group,
            }
            for e in self.which
        ]
        g, named, w = self.gap, self.closing, self.where
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "cause": list(self.cause),
            "axis": self.axis,
            "where": {**w.to_json(), "controller_distance": w.controller},
            "which": which,
            "likely": {"level": LEVEL, "hypotheses": [list(e.effects) for e in self.likely]} if self.likely else None,
            "rareness": None if self.rareness is None else dict(zip(("p", "known"), self.rareness, strict=True)),
            "indistinguishable": [list(c) for c in self.indistinguishable],
            "next_experiments": None if self.next_experiments is None else self.next_experiments.to_json(),
            "gap": {
                "before": g.before,
                "calibrated": g.calibrated,
                "after": g.after,
                "floor": g.floor,
                "closed_fraction": named.closed_fraction,
                "nominal_levitates": g.before is not None,
                "fit": None if g.figures is None else asdict(g.figures),
                "closed_fraction_ci": None if named.closed_fraction_ci is None else list(named.closed_fraction_ci),
                "corrected_closed_fraction": g.closed_fraction,
                "corrected_closed_fraction_ci": None if g.closed_fraction_ci is None else list(g.closed_fraction_ci),
                "judged_on": g.judged_on,
                "stiffness_error": errors(g, "stiffness"),
                "damping_error": errors(g, "damping"),
                "peak_sensitivity_error": errors(g, "peak_sensitivity"),
                "regret": None if self.choice is None else _choice(self.choice),
                "foils": dict(g.foils),
            },
            "corrected": {"effects": {n: dict(v) for n, v in self.corrected.effects.items()},
                          "changes": dict(self.corrected.changes), "by": self.corrected_by},
            "free": None if self.free is None else self.free.to_json(),
            "unexplained": None if self.leftover is None else self.leftover.to_json(),
            "tempering": self.tempering,
            "unseen": list(self.unseen),
            "off_balance": self.off_balance,
            "bursts": [asdict(b) for b in self.bursts],
            "wrong_reading": None if self.misread is None else asdict(self.misread),
            "wrong_gain": None if self.wrong_gain is None else asdict(self.wrong_gain),
            "tones": {name: [asdict(tone) for tone in tones] for name, tones in self.tones.items()},
            "between_lines": None if self.between is None else asdict(self.between),
            "notes": list(self.notes),
            "left_out": left_out_data(self.campaign.left_out),
            "seconds": self.seconds,
        }  # fmt: skip


def fitted_parameters(candidate: Candidate) -> Mapping[str, Fitted]:
    """Fitted parameters with standard errors, named "effect.parameter", or "parameter (relative)" for tolerances.

    A parameter that ended at its bound has no standard error: it is not identified. Nor has one that nothing tells, or
    any of a candidate that is so far behind the best that it was not fitted again under the final noise. What a fit
    leaves beyond the noise widens all others (see `_widened`).
    """
    fit, found = candidate.fit, {}
    known = fit.jacobian is not None
    sd = _widened(fit) if known else np.full(fit.u.size, np.nan)
    for i, c in enumerate(fit.hypothesis.coordinates):
        value = c.value(float(fit.u[i]))
        at_bound = c.at_bound(float(fit.u[i]))
        se = None if at_bound or not known or sd[i] >= NOT_TOLD else _se(c, value, float(sd[i]))
        if counted := fit.hypothesis.seen.get(c.effect):  # which tells it better than what it does on average
            (value, se), at_bound = by_count(*counted), False
        found[f"{c.effect}.{c.parameter}"] = {"value": value, "se": se, "at_bound": at_bound}
    forms = list(enumerate(fit.hypothesis.calibrated, len(fit.hypothesis.coordinates)))
    shapes = fit.hypothesis.shapes
    # What a form adds, such as a further mode, is nowhere as long as it has no size.
    added = [(s, s.value(float(fit.u[i]))) for i, n in forms if (s := shapes.get(n)) and s.parameter.added]
    there = {s.effect for s, value in added if s.parameter.scale and value != s.parameter.default}
    for i, name in forms:
        if shape := shapes.get(name):
            if shape.parameter.added and shape.effect not in there:
                continue
            if shape.parameter.default == inf and abs(fit.u[i]) <= max(NOWHERE, sd[i] if known else 0.0):
                continue  # not told from one that is so large that it does nothing
            if (value := shape.value(at := float(fit.u[i]))) != shape.parameter.default:
                at_end = at in (shape.bounded(at - 1.0), shape.bounded(at + 1.0))
                se = None if at_end or not known else float(sd[i]) * shape.change(at)
                if not shape.parameter.added and se and abs(value - shape.parameter.default) < TOLD * se:
                    continue  # not told from the plain formula
                # All of a share is a form of its own, and not the end of a search.
                at_bound = at_end and (shape.parameter.low, shape.parameter.high) != (0.0, 1.0)
                found[name] = {"value": value, "se": se, "at_bound": at_bound}
            continue
        sigma = fit.hypothesis.sigma(name)
        change = float(fit.u[i]) * sigma
        se = float(sd[i]) * sigma if known else None
        found[f"{name} (relative)"] = {"value": change, "se": se, "at_bound": False}
    return {name: at for name, at in found.items() if not _instead(name, at, found)}


def _instead(name: str, at: Fitted, found: Mapping[str, Fitted]) -> bool:
    """Whether a limit is so far away that nothing tells it, and another one of its effect acts in its place: the field
    at which iron saturates, where the current does."""
    effect, _, key = name.partition(".")
    if not key or EFFECTS[effect].parameters[key].absent != inf or (at["se"] or inf) < abs(at["value"]):
        return False
    others = (other.partition(".") for other in found if other != name)
    return any(e == effect and EFFECTS[e].parameters[k].default == inf for e, _, k in others if k)


def _widened(fit: Fit) -> np.ndarray:
    """Standard errors (size,) with the misfit for noise: the variance of the data is that many times larger, and that
    of what is known beforehand is not. With H = J J^T + P of a fit they are the roots of H^-1 (misfit J J^T + P) H^-1.
    """
    more, covariance = surplus(fit) - 1.0, fit.covariance()
    variance = np.diag(covariance)
    by_prior = np.divide((covariance**2) @ fit.prior, variance, out=np.ones_like(variance), where=variance > 0)
    return fit.spread * np.sqrt(1.0 + more * (1.0 - np.minimum(by_prior, 1.0)))


def _se(c: Coordinate, value: float, sd: float) -> float:
    return value * sd if c.scale is None else c.scale * sd


def _choice(choice: GainChoice) -> dict[str, Any]:
    nominal, corrected = choice.chosen
    return {
        "before": choice.regret,
        "rank_correlation": choice.rank_correlation,
        "judged_by": "the corrected simulator",
        "gains": {"nominal": dict(zip(("kp", "kd"), nominal, strict=True)),
                  "corrected": dict(zip(("kp", "kd"), corrected, strict=True))},
    }  # fmt: skip


def block_of(name: str) -> str:
    """Block of an effect, or of several effects written "a+b"."""
    return "+".join(dict.fromkeys(EFFECTS[part].block for part in name.split("+")))
