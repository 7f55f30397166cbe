"""A diagnosis in words, for a table, a page and the comment of the corrected rig."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from estimation.normal import NORMAL_95
from maglev_env.loop.effect import EFFECTS
from maglev_env.loop.free.places import NAMES as FREE
from sim2real.compared.commands_seen import stalled
from sim2real.gap.leftover import Leftover
from sim2real.gap.leftover_words import fit_in_words, leaves, parameters_in_words, partial_in_words
from sim2real.gap.locate import ALL_DRIVEN, Where
from sim2real.gap.shrink import Gap
from sim2real.judgement.judge import Entry
from sim2real.judgement.tones.tone_sizes import tones_in_words
from sim2real.judgement.verdict import CLASS_SHARE, with_effects
from sim2real.lags_in_words import whole_lags
from sim2real.result import OFFSET, Diagnosis, block_of, fitted_parameters
from sim2real.search.hypotheses import CALIBRATION, NONE, REPLACED, UNKNOWN
from sim2real.words import Fitted, fitted_quantity, percent, quantity

SHOWN_BANDS, LEAST_SHARE = 3, 0.05
BEYOND = 3.0  # a calibrated change of more than this many stated tolerances is said
MAY_BE = 0.1  # a probability that is worth a word beside "no gap"
NOTHING = {(NONE,), (CALIBRATION,)}  # hypotheses under which no effect acts
MOSTLY = 0.9  # of a gap: what closes as much, surely, is worth a word although something else is left
NONE_LEFT = 0.005  # share of the gap below which nothing is left
NO_SHARE = "too near to the noise for a share that is closed"  # of a gap whose sizes before and after are known


@dataclass(frozen=True)
class Correction:
    """One parameter of the corrected rig.

    Attributes:
        name: "effect.parameter" such as "delay.time", or a nominal parameter such as "mass".
        value: Value in SI units, or the relative change.
        se: Standard error; None where it is not known.
        unit: Unit of the value.
        is_change: Whether the value is a relative change of a nominal parameter within its tolerance.
        at_bound: Whether the fit ended at the end of the range that it searches, so that it is no estimate.
    """

    name: str
    value: float
    se: float | None
    unit: str
    is_change: bool
    at_bound: bool = False

    @property
    def fitted(self) -> Fitted:
        """Its value with its error, as JSON data."""
        return Fitted(value=self.value, se=self.se, at_bound=self.at_bound)

    def __str__(self) -> str:
        return fitted_quantity(self.fitted, self.unit, self.is_change)


def named(diagnosis: Diagnosis) -> tuple[Entry, ...]:
    """The hypotheses that name effects, the most probable first."""
    return tuple(with_effects(diagnosis.which))


def corrections(diagnosis: Diagnosis) -> tuple[Correction, ...]:
    """Parameters of the corrected rig, effects first, with their standard errors."""
    effects = next((e.effects for e in named(diagnosis)), (CALIBRATION,))
    if diagnosis.verdict not in ("explained", "ambiguous"):
        effects = (CALIBRATION,)
    listed = diagnosis.to_json()["which"]
    fitted = next((row["parameters"] for row in listed if tuple(row["effects"]) == effects), {})
    if diagnosis.by_partial is not None:
        fitted = fitted_parameters(diagnosis.by_partial)
    elif diagnosis.free is not None and diagnosis.corrected_freely:  # the rig is that of the fit with the correction
        fitted = fitted_parameters(diagnosis.free.candidate)
    found = []
    for name, values in diagnosis.corrected.effects.items():
        if name in FREE:
            continue  # the coefficients of a free correction mean nothing by themselves: it is drawn and described
        in_fit = any(known.startswith(f"{name}.") for known in fitted)
        for key, value in values.items():
            at, parameter = fitted.get(f"{name}.{key}", {}), EFFECTS[name].parameters[key]
            # The phase of a tone, which begins anew in every recording, what a further mode without a size would be, a
            # form that is not told from the plain one, and a limit that another one stands for are no findings.
            of_form = in_fit and (key in EFFECTS[name].shapes or parameter.absent == inf)
            if not at and (key == "phase" or parameter.added or of_form):
                continue
            ended = at.get("at_bound", False)
            found.append(Correction(f"{name}.{key}", value, at.get("se"), parameter.unit, key == "change", ended))
    for name, value in diagnosis.corrected.changes.items():
        found.append(Correction(name, value, fitted.get(f"{name} (relative)", {}).get("se"), "", True))
    return tuple(found)


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    said = _verdict(diagnosis)
    if diagnosis.axis is None:
        return said
    return f"No known effect of both axes explains the gap; along {diagnosis.axis} alone, {said[:1].lower()}{said[1:]}"


def _verdict(diagnosis: Diagnosis) -> str:
    """The verdict on all axes that were diagnosed, in one sentence."""
    probability = {e.effects: e.probability for e in diagnosis.which}
    if diagnosis.verdict == "no_gap":
        sure = probability.get((NONE,), 0.0) + probability.get((CALIBRATION,), 0.0)
        within = f"({percent(sure)}{_not_excluded(diagnosis)})"
        if sure < max((e.probability for e in diagnosis.which if e.effects not in NOTHING), default=0.0):
            return f"Nothing is named: no effect may be needed {within}{_far_off(diagnosis)}{_loud(diagnosis)}."
        if far := _far(diagnosis):
            stated = f"but the rig is not as stated: {', '.join(far)}"
            return f"No effect is needed {within}, {stated}{_loud(diagnosis)}."
        clear = f"There is no gap beyond the noise and the rig's stated tolerances {within}"
        return f"{clear}{_from_current(diagnosis)}{_off_balance(diagnosis)}{_loud(diagnosis)}."
    left, unknown = diagnosis.leftover, probability.get((UNKNOWN,), 0.0)
    # Where the holdout refutes what is most probable, an unknown cause need not have become that.
    refuted = diagnosis.which[0].effects != (UNKNOWN,)
    none = f"No {'effect that fits is borne out by the holdout' if refuted else 'known effect explains the gap'}"
    if not refuted and (beside := _between(diagnosis)):
        none = f"No known effect explains what lies between the lines of the drive, {beside}"
    if diagnosis.verdict == "unexplained" and left is not None:
        return (
            f"{none} (unknown: {percent(unknown)}); best partial "
            f"explanation: {partial_in_words(left)}, which {leaves(left)}{_left_where(left)}{_refitted(diagnosis)}"
            f"{_loud(diagnosis)}{_misread(diagnosis)}."
        )
    if diagnosis.verdict == "unexplained":
        return (
            f"{none} (unknown: {percent(unknown)}); most of it lies in {_blocks(_largest(diagnosis.where.blocks))}"
            f"{_highest_band(diagnosis.where)}{_refitted(diagnosis)}{_loud(diagnosis)}{_misread(diagnosis)}."
        )
    if diagnosis.verdict == "ambiguous":
        rows = [e for e in named(diagnosis) if "+".join(e.effects) in diagnosis.cause]
        one_of = _or([f"{_and(e.effects)} ({percent(e.probability)})" for e in rows])
        blocks = _or([*dict.fromkeys(_blocks(block_of(name)) for name in diagnosis.cause)])
        return (
            f"The gap is explained by {one_of}, in {blocks}; this campaign cannot tell them apart{_besides(diagnosis)}"
            f"{_misread(diagnosis)}."
        )
    top = named(diagnosis)[0]
    more = sum(e.probability for e in diagnosis.which if set(e.effects) > set(top.effects))
    beside = f", {percent(more)} with another effect beside" if more >= CLASS_SHARE * top.probability else ""
    closes = _closes(diagnosis.closing, only_tones(diagnosis))
    return (
        f"The gap is explained by {_and(top.effects)} ({percent(top.probability)}{beside}), in "
        f"{_blocks(block_of('+'.join(top.effects)))}{_sizes(diagnosis, top)}{closes}{_besides(diagnosis)}"
        f"{_misread(diagnosis)}."
    )


def _sizes(diagnosis: Diagnosis, top: Entry) -> str:
    """Parameters of the effects that are named with 95 % intervals, as the middle of a sentence."""
    heard = {name: tones for name, tones in diagnosis.tones.items() if name in top.effects}
    moved = {n for n, v in diagnosis.corrected.effects.items() if any(v.values())}  # a lag may sit in a stated pole
    shown = [c for c in corrections(diagnosis) if "." in c.name and c.name.partition(".")[0] in moved - heard.keys()]
    fitted = parameters_in_words({c.name: c.fitted for c in shown}, top.effects)
    tones = ", ".join(tones_in_words(name, sizes, NORMAL_95) for name, sizes in heard.items())
    return "".join(f"; {text}" for text in (fitted, f"{tones} (95 %)" if tones else "") if text)


def _left_where(left: Leftover) -> str:
    """Where most of what is left lies, as the middle of a sentence; empty where nothing is left."""
    if left.share is not None and left.share < NONE_LEFT:
        return ""
    return f", most of it in {_blocks(_largest(left.where.blocks))}{_highest_band(left.where)}"


def _between(diagnosis: Diagnosis) -> str:
    """What varies over time and has no name, where hardly anything else is left; else empty."""
    left = diagnosis.leftover
    if diagnosis.between is None or left is None or left.share is None or left.share > 1 - MOSTLY:
        return ""
    return diagnosis.between.in_words()


def _not_excluded(diagnosis: Diagnosis) -> str:
    """What may act although nothing is named, as the rest of a bracket: hypotheses as probable as one in ten."""
    may = [e for e in diagnosis.which if e.effects not in NOTHING and e.probability >= MAY_BE]
    names = ["an unknown effect" if e.effects == (UNKNOWN,) else _and(e.effects) for e in may]
    said = [f"{name} {percent(e.probability)}" for name, e in zip(names, may, strict=True)]
    return f"; not excluded: {', '.join(said)}" if said else ""


def _far_off(diagnosis: Diagnosis) -> str:
    """What is off where no effect acts, as the end of a sentence."""
    far = _far(diagnosis)
    return f"; if none acts, the rig is not as stated: {', '.join(far)}" if far else ""


def _from_current(diagnosis: Diagnosis) -> str:
    """What does not show, where only what follows the current was compared or a time that is not stated hides a lag; as
    the end of a sentence."""
    late = diagnosis.late
    said = ""
    if set(diagnosis.unseen) - {OFFSET} - (frozenset() if late is None else late.effects):
        said = " from the current on; what acts before it, such as a delay of the command, does not show in these "
        said += "recordings"
    return said if late is None else f"{said}; {late.briefly}"


def _off_balance(diagnosis: Diagnosis) -> str:
    """What the means contradict although the motion shows nothing; as the end of a sentence."""
    return "" if diagnosis.off_balance is None else f" in the motion; but {diagnosis.off_balance}"


def _loud(diagnosis: Diagnosis) -> str:
    """What is odd about what passes for noise, as the end of a sentence: louder than the rig states, or in bursts."""
    said = ""
    if diagnosis.loud:
        times = f"{max(diagnosis.loud.values()):.2g} times as loud as the noise that the rig states"
        said = f"; but what passes for noise is {times}, and no recording repeats to tell"
    if stalled(diagnosis.notes):
        said += "; but several commands in turn are lost, as of a controller that stalls"
    if diagnosis.bursts:
        said += f"; but something comes in bursts ({', '.join(b.record for b in diagnosis.bursts)})"
    return said


def _misread(diagnosis: Diagnosis) -> str:
    """A channel or a gain of the controller that would explain as much, as the end of a sentence."""
    return "".join(f"; but {said.briefly}" for said in (diagnosis.wrong_gain, diagnosis.misread) if said is not None)


def tempered(diagnosis: Diagnosis) -> str:
    """Why probabilities are less sure than noise alone would make them, in one sentence; empty where they are not."""
    return f"{diagnosis.notes[0][0].upper()}{diagnosis.notes[0][1:]}." if diagnosis.tempering > 1 else ""


def _besides(diagnosis: Diagnosis) -> str:
    """What is as little as stated as an effect would be, although it is not called one; as the end of a sentence."""
    far = _far(diagnosis)
    lags = f"; in all, {' and '.join(found)}" if (found := whole_lags(diagnosis, causes_of(diagnosis))) else ""
    return lags + (f"; besides, the rig is not as stated: {', '.join(far)}" if far else "")


def _refitted(diagnosis: Diagnosis) -> str:
    """What is said of stated parameters that a fit has moved far from what is stated where no effect explains the gap,
    as the end of a sentence: a wrong data sheet beside a little of something else, or what takes up an effect."""
    closed, far = diagnosis.gap.closed_fraction_ci, _far(diagnosis)
    if not far:
        return ""
    if diagnosis.corrected.effects or closed is None or closed[0] < MOSTLY:
        return f"; to take up what has no name the fit moved {', '.join(far)}, which are no findings"
    told = f"closes {percent(diagnosis.gap.closed_fraction)} of the gap"
    return f"; but the same rig with other parameters {told}, so first check {', '.join(far)}"


def causes_of(diagnosis: Diagnosis) -> frozenset[str]:
    """The effects that a diagnosis names, alone or with others."""
    return frozenset(name for cause in diagnosis.cause for name in cause.split("+"))


def _far(diagnosis: Diagnosis) -> list[str]:
    """Calibrated parameters that have moved by more than BEYOND stated tolerances; without the time constant of a block
    whose lag is named, of which nobody can tell a share."""
    parts = {REPLACED[name] for name in causes_of(diagnosis) if name in REPLACED}
    stated = {name: sigma for name, sigma in diagnosis.rig.tolerance.items() if name not in parts}
    moved = ((c, abs(c.value) / stated[c.name]) for c in corrections(diagnosis) if c.is_change and c.name in stated)
    return [
        f"{c.name} {quantity(c.value, c.se and NORMAL_95 * c.se, c.unit, True)}{' (95 %)' if c.se else ''}, "
        f"{far:.2g} tolerances off"
        for c, far in moved
        if far > BEYOND
    ]


def only_tones(diagnosis: Diagnosis) -> bool:
    """Whether tones or a drift alone are named: what is compared does not show them, and calibration closes its gap."""
    named_first = next(iter(named(diagnosis)), None)
    if named_first is None or named_first.candidate is None:
        return False
    return not diagnosis.attribution.candidates[named_first.candidate].effects


def _closes(gap: Gap, by_calibration: bool) -> str:
    """How much of the gap is closed, as the end of a sentence; where that has no meaning, the fit's own figures."""
    if gap.closed_fraction is not None:
        closed = f"{round(100 * gap.closed_fraction)} % of the gap{closed_spread(gap)}"
        return f"; beside it, calibration closes {closed}" if by_calibration else f"; it closes {closed}"
    if gap.before is not None and gap.after is not None:
        return (
            f"; on the {gap.judged_on} the gap is {gap.before:.2g} times the noise before and {gap.after:.2g} after: "
            f"{NO_SHARE}"
        )
    if gap.before is None and gap.figures is not None:
        fit = fit_in_words(gap.figures)
        return (
            f"; the nominal rig does not levitate with the recorded gains, so no share is closed; the fit leaves {fit}"
        )
    return ""


def closed_spread(gap: Gap) -> str:
    """The interval of the share that is closed, in brackets; empty where it is nothing but 100 %."""
    ends = gap.closed_fraction_ci
    if ends is None or round(100 * ends[0]) >= 100:
        return ""
    return f" (95 %: {100 * ends[0]:.0f} .. {100 * ends[1]:.0f})"


def _largest(shares: Mapping[str, float]) -> str:
    """The name with the largest share; empty where all are zero."""
    return max(shares, key=lambda name: shares[name]) if any(shares.values()) else ""


def where_in_words(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Blocks, bands and kinds of lines with their shares of what calibration leaves."""
    where = diagnosis.where
    if not where.significant:
        return ("what calibration leaves stands out of the noise in no block, band or kind of line",)
    bands = sorted((b for b in where.bands if b[2] > 0), key=lambda b: -b[2])[:SHOWN_BANDS]
    return (
        "blocks: " + _shares({name.replace("+", " + "): share for name, share in where.blocks.items()}),
        "bands: " + _shares({f"{lo:.3g} .. {hi:.3g} Hz": share for lo, hi, share in bands}),
        "kind: " + (_shares(where.kind) if where.between else ALL_DRIVEN),
        *(["axes: " + _shares(where.axes)] if where.axes else []),
    )


def _shares(shares: Mapping[str, float]) -> str:
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    kept = [f"{name} {percent(share)}" for name, share in ordered if share >= LEAST_SHARE]
    return ", ".join(kept) or ("spread evenly" if any(shares.values()) else "none stands out of the noise")


def _highest_band(where: Where) -> str:
    bands = where.bands
    if not bands or not any(share for *_, share in bands):
        return ""
    lo, hi, _ = max(bands, key=lambda b: b[2])
    return f", around {lo:.3g} .. {hi:.3g} Hz"


def _and(names: tuple[str, ...]) -> str:
    return " with ".join(names)


def _or(words: list[str]) -> str:
    return " or ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def _blocks(joined: str) -> str:
    if not joined:
        return "no block in particular"
    words = {"external": "what turns with the rotor or acts from outside"}
    return " and ".join(words.get(name, f"the {name}") for name in joined.split("+"))
