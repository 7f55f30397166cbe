"""Reports of `maglev diagnose`: text for a terminal, and a page."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from maglev_env.loop.effect import EFFECTS
from maglev_env.units import prefixed
from maglev_workbench.commands.diagnose.figures import gap_bars, loop_diagram, ranking, responses, shares
from maglev_workbench.commands.diagnose.free import free_sections
from maglev_workbench.commands.diagnose.leftover import leftover_sections
from maglev_workbench.commands.diagnose.minded import minded
from maglev_workbench.console import marked
from maglev_workbench.page import html_text, note, number, page, table
from sim2real.advice.gain_choice import GainChoice
from sim2real.advice.next_experiment import SEPARATED
from sim2real.advice.proposal import Proposal
from sim2real.curves import curves
from sim2real.gap.leftover_words import fit_in_words, leftover_lines
from sim2real.gap.locate import ALL_DRIVEN
from sim2real.gap.shrink import REFIT, errors
from sim2real.judgement.judge import Entry
from sim2real.judgement.tones.tone_sizes import tones_in_words
from sim2real.report import (
    BEYOND,
    NO_SHARE,
    Correction,
    closed_spread,
    corrections,
    only_tones,
    sentence,
    tempered,
    where_in_words,
)
from sim2real.result import Diagnosis, block_of
from sim2real.search.hypotheses import CALIBRATION, NONE, UNKNOWN
from sim2real.words import Fitted, fitted_quantity, percent, spoken

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
    from rich.console import RenderableType

NO_BETTER = 1.02  # a control effect that leaves less than this times the remaining gap fits as well as the named one
TOP, LEAST = 5, 0.005  # hypotheses listed with their parameters, and their least probability
_WORDS = {"stiffness": ("stiffness", "N/m"), "damping": ("damping", "N s/m"), "peak_sensitivity": ("peak |S|", "")}
_MEANING = {
    NONE: "the nominal rig as it is",
    CALIBRATION: "the nominal rig, its parameters changed within their tolerances",
    UNKNOWN: "something that is not among the known effects",
}
_EFFORTS = {1: "software", 2: "wiring", 3: "hardware"}
_NOTES = {
    "where": "Shares of the noise-weighted gap that calibration within tolerance leaves. The bars below the loop are "
    "the segments that the recorded channels isolate; the darker a block, the more of the gap may lie there. What is "
    "blamed stands in its block.",
    "which": "±: standard error. Worst group: of all parts of the gap that stand out of the noise (channel, kind of "
    "line, octave), the least share that the hypothesis explains.",
    "words": "Stiffness and damping at the force lines of the rig's target band, peak |S| of the injection lines: of "
    "the recordings that judge, and of the same lines simulated.",
    "responses": "Shaded: two standard deviations. Below: the distance from the measured response in units of its "
    "noise; 1 (dotted) is noise alone.",
    "kind": "Linear: lines that are excited. Even, odd: lines between them, where only distortion answers. "
    "Unsynchronised: tones that are no line, of the mains or of the rotation.",
    "next": "Expected separation: -2 ln of the likelihood ratio between the two remaining candidates that are most "
    "alike. Together the proposals separate all that can be told apart, for the least effort.",
    "corrected": "Written as corrected.toml beside this page: maglev sweep --rig corrected.toml, or "
    'gym.make("maglev/Rig-v0", rig="corrected.toml").',
}
WITHIN = 2.0  # stated tolerances that a calibrated parameter is off by at most to be called within them
_RANK_HEAD = ("hypothesis", "probability", "where", "parameters", "worst group")
_GAP_HEAD = ("", "measured", "nominal", "error", "corrected", "error")


def terminal(diagnosis: Diagnosis, warnings: Sequence[Mapping[str, Any]] = ()) -> "list[RenderableType]":
    """The parts of the text for a terminal, in order, in 80 columns; warnings: as of `minded`."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    parts: list[RenderableType] = [Text(sentence(diagnosis), "bold")]
    if told := tempered(diagnosis):
        parts.append(told)
    parts += [marked("mind", text) for text in minded(diagnosis, warnings)]
    parts += [f"  {line}" for line in where_in_words(diagnosis)]
    if diagnosis.leftover is not None:
        parts += [f"  {line}" for line in leftover_lines(diagnosis.leftover)]
    if diagnosis.free is not None:
        parts.append(diagnosis.free.sentence())
    ranked = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in _RANK_HEAD:
        if name != "where":  # left out because a terminal is narrow, and the blocks are given above
            side = "right" if name in ("probability", "worst group") else "left"
            ranked.add_column(name, justify=side, overflow="fold")
    for i, (name, probability, _, *rest) in enumerate(_ranked(diagnosis)):
        ranked.add_row(name, probability, *rest, style="bold" if i == 0 else "")
    ranked.caption = "+-: standard error. Worst group: least share explained of any part of the gap."
    parts += [ranked, *_gap_lines(diagnosis)]
    if rows := _word_rows(diagnosis):
        words = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for name in _GAP_HEAD:
            words.add_column(name, justify="right" if name else "left")
        for row in rows:
            words.add_row(*row)
        parts.append(words)
    found = corrections(diagnosis)
    if diagnosis.verdict in ("explained", "ambiguous"):
        found = tuple(c for c in found if "." not in c.name)  # its effects are in the sentence and the table
    if found:
        parts.append(f"{_calibrated(diagnosis, found)}: {', '.join(f'{c.name} {c}' for c in found)}.")
    for word, text in zip(("Measure next:", "Then:", "Then:"), _next(diagnosis), strict=False):
        parts.append(marked(word, text, "bold"))
    if untold := _untold(diagnosis):
        parts.append(marked("Not to be told:", untold, "bold"))
    parts += [marked("  left out", str(one)) for one in diagnosis.campaign.left_out]
    return parts + [f"  note: {text}" for text in diagnosis.notes[bool(told) :]]


def _calibrated(diagnosis: Diagnosis, found: Sequence[Correction]) -> str:
    """The words before calibrated parameters."""
    if diagnosis.verdict in ("explained", "ambiguous"):
        return "Calibration beside it"
    if diagnosis.verdict == "unexplained":
        if diagnosis.by_partial is not None:
            return "Fitted beside the best partial explanation"
        return "Fitted beside the free correction" if diagnosis.corrected_freely else "Calibration, as far as it goes"
    stated = diagnosis.rig.tolerance
    far = any(abs(c.value) > WITHIN * stated[c.name] for c in found if c.name in stated)
    return "Calibration" if far else "Within tolerance"


def capitalised(text: str) -> str:
    """A sentence with a capital, unless it begins with the name of an effect or parameter, which has an underscore."""
    return text if "_" in text.partition(" ")[0] else f"{text[:1].upper()}{text[1:]}"


def diagnose_page(diagnosis: Diagnosis, warnings: Sequence[Mapping[str, Any]] = ()) -> str:
    """The HTML of a diagnosis."""
    d = diagnosis
    blamed = tuple(dict.fromkeys(part for name in d.cause for part in name.split("+")))
    sections: list[tuple[str, str | Figure]] = [
        ("Where the gap lies", loop_diagram(d, blamed)),
        *(("", note(f"{capitalised(text)}.")) for text in minded(d, warnings)),
        ("", _list(where_in_words(d)) + note(_NOTES["where"])),
        *([] if d.leftover is None else leftover_sections(d.leftover)),
        *([] if d.free is None else free_sections(d.free)),
        ("Which effect", ranking(d)),
        ("", _wrapped(table(_RANK_HEAD, [map(_typeset, row) for row in _ranked(d)])) + note(_NOTES["which"])),
        ("How far the gap shrinks", gap_bars(_gap_rows(d))),
        ("", "".join(map(note, _gap_lines(d)))),
    ]
    if rows := _word_rows(d):
        sections.append(("", table(_GAP_HEAD, rows) + note(_NOTES["words"])))
    sections += _responses(d)
    kind = _NOTES["kind"] if d.where.between else f"{_NOTES['kind']} Here the kind is {ALL_DRIVEN}."
    if d.where.significant and any(share for *_, share in d.where.bands):
        sections += [("The gap by band and by kind of line", shares(d)), ("", note(kind))]
    sections += _next_sections(d)
    sections.append(("The corrected rig", _corrections(corrections(d), d) + note(_NOTES["corrected"])))
    if d.campaign.left_out:
        sections.append(("Left out", _list([str(one) for one in d.campaign.left_out])))
    if notes := d.notes[bool(tempered(d)) :]:
        sections.append(("Notes", _list(notes)))
    answer = " ".join(filter(None, (sentence(d), tempered(d))))
    return page(f"Diagnosis of {d.campaign.folder.resolve().name}", _typeset(answer), sections, _made_by(d))


def _wrapped(html: str) -> str:
    """A table whose cells may contain line breaks, because the parameters of two effects are wider than a page."""
    return html.replace("<td>", '<td class="wrapped">')


def _typeset(text: str) -> str:
    return text.replace(" +- ", " ± ")


def _list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{html_text(line)}</li>" for line in lines) + "</ul>"


def _made_by(d: Diagnosis) -> dict[str, object]:
    recorded = {role: ", ".join(r.name for r in d.campaign.recordings if r.role == role) for role in ("fit", "holdout")}
    return {
        "Campaign": d.campaign.folder,
        "Nominal rig": d.campaign.rig.name,
        "Fitted recordings": recorded["fit"],
        "Judged on": recorded["holdout"] or d.gap.judged_on,
        "Version": version("maglev-workbench"),
    }


def _ranked(d: Diagnosis) -> list[tuple[str, ...]]:
    """Cells of the most probable hypotheses."""
    listed = {tuple(row["effects"]): row["parameters"] for row in d.to_json()["which"]}
    return [
        (
            " + ".join(e.effects),
            percent(e.probability),
            _place(e),
            ", ".join(_parameters_of(e, listed.get(e.effects, {}), d)) or _MEANING.get(e.effects[0], ""),
            "–" if e.explained_worst_group is None else percent(max(e.explained_worst_group, 0.0)),
        )
        for e in d.which[:TOP]
        if e.probability >= LEAST
    ]


def _place(e: Entry) -> str:
    return "" if e.effects[0] in _MEANING else block_of("+".join(e.effects)).replace("+", " + ")


def _parameters_of(e: Entry, fitted: Mapping[str, Fitted], d: Diagnosis) -> list[str]:
    """Parameters of effects as texts; changes within tolerance are in the table of the corrected rig."""
    found = []
    for name, at in fitted.items():
        effect, _, key = name.partition(".")
        if key:
            text = fitted_quantity(at, EFFECTS[effect].parameters[key].unit, key == "change")
            found.append(f"{spoken(name, list(e.effects) != [effect])} {text}")
    return found or [tones_in_words(name, d.tones[name]) for name in e.effects if name in d.tones]


def _gap_rows(d: Diagnosis) -> list[tuple[str, float | None]]:
    g = d.gap
    rows = [("nominal", g.before), ("calibrated within tolerance", g.calibrated)]
    if d.corrected.effects:
        rows.append(("corrected", g.after))
    return rows + [(f"foil: {name}", value) for name, value in g.foils.items() if value is not None]


def _gap_lines(d: Diagnosis) -> list[str]:
    g = d.gap
    before, after = ("does not levitate" if v is None else number(v) for v in (g.before, g.after))
    corrected = " with the free correction" if d.corrected_freely else ""
    if d.by_partial is not None:
        corrected = " with the best partial explanation"
    sizes = f"{before} before, {after} after{corrected} (floor {g.floor:g})"
    lines = [f"Gap on the {g.judged_on}, in units of the noise: {sizes}."]
    if g.closed_fraction is not None:
        lines[0] = lines[0][:-1] + f"; {round(100 * g.closed_fraction)} % closed{closed_spread(g)}."
    elif g.before is not None and g.after is not None:
        lines[0] = lines[0][:-1] + f": {NO_SHARE}."
    if g.before is None:
        lines[0] += " The nominal rig does not levitate with the recorded gains, so there is no share to close."
    if g.grows and d.corrected.changes:
        lines[0] += " The corrected rig is farther from it than the nominal one: do not use it."
    if g.figures is not None:
        lines.append(f"The fit itself: {fit_in_words(g.figures)}.")
    foils = {name: value for name, value in g.foils.items() if value is not None}
    if foils and d.corrected.effects:
        text = "Foils: " + ", ".join(f"{name} leaves {number(value)}" for name, value in foils.items()) + "."
        own = None if d.verdict == "unexplained" or only_tones(d) else d.closing.after
        # All parameters, fitted again, are no rival of an effect that is another value of one of them.
        itself = all(EFFECTS[name].nominal for name in d.corrected.effects)
        rivals = [value for name, value in foils.items() if name != REFIT or not itself]
        if own is not None and rivals and min(rivals) < NO_BETTER * own:
            text += " The named effect does not beat them, so the diagnosis is weak."
        lines.append(text)
    if d.choice is not None:
        lines.append(_choice_line(d.choice))
    return lines


def _choice_line(choice: GainChoice) -> str:
    """A sentence on how the gap changes the choice of gains."""
    nominal, corrected = (f"kp x {kp:g}, kd x {kd:g}" for kp, kd in choice.chosen)
    if nominal == corrected:
        text = f"Gains: of {len(choice.nominal)} sets both simulators choose {nominal}"
    else:
        text = (
            f"Gains: of {len(choice.nominal)} sets the nominal simulator chooses {nominal}, the corrected one "
            f"{corrected}, which it scores {number(choice.regret)} higher"
        )
    if choice.rank_correlation is None:
        return text + "."
    return f"{text}; they rank the sets alike by {number(choice.rank_correlation)} (Spearman)."


def _word_rows(d: Diagnosis) -> list[tuple[str, ...]]:
    """Stiffness, damping and peak sensitivity, measured and simulated, if the lines determine them."""
    rows = []
    for name, (label, si) in _WORDS.items():
        scale, unit = prefixed(getattr(d.gap.words["measured"], name), si)
        at = {when: getattr(words, name) * scale for when, words in d.gap.words.items()}
        if at["measured"] == at["measured"]:
            off = {
                when: "–" if v is None else f"{'+' if v > 0 else ''}{number(100 * v, 2)} %"
                for when, v in errors(d.gap, name).items()
            }
            cells = (at["measured"], at["before"], off["before"], at["after"], off["after"])
            rows.append((f"{label} {unit}".rstrip(), *(c if isinstance(c, str) else number(c, 4) for c in cells)))
    return rows


def _next(d: Diagnosis) -> list[str]:
    """What to record next, one sentence each, in order."""
    if d.next_experiments is None:
        return []
    return [f"{p.what}{_repeated(p, d)}; {p.why}{_separating(p)}." for p in d.next_experiments.proposals]


def _untold(d: Diagnosis) -> str:
    """What no recording of the menu decides."""
    if d.next_experiments is None or not d.next_experiments.untold:
        return ""
    return f"no recording that is known here tells {'; nor '.join(d.next_experiments.untold)}."


def _repeated(p: Proposal, d: Diagnosis) -> str:
    """Which recording "the same" is, where there are several."""
    return f" ({p.of})" if p.of and len(d.campaign.recordings) > 1 else ""


def _separating(p: Proposal) -> str:
    if p.expected_separation is None:
        return ""
    return f" (expected separation {number(p.expected_separation)}; {SEPARATED:g} tell them apart)"


def _next_sections(d: Diagnosis) -> "list[tuple[str, str | Figure]]":
    plan = d.next_experiments
    if plan is None:
        return []
    texts = "".join(f"<li>{html_text(text)}</li>" for text in _next(d))
    untold = f"<p>{html_text(capitalised(said))}</p>" if (said := _untold(d)) else ""
    found: list[tuple[str, str | Figure]] = [("What to measure next", (f"<ol>{texts}</ol>" if texts else "") + untold)]
    if computed := [c for c in plan.menu if c.expected_separation is not None]:
        rows = []
        for c in computed:
            value = c.expected_separation or 0.0
            rows.append(
                (c.what, _EFFORTS[round(c.effort)], number(value), "yes" if value > SEPARATED else "not surely")
            )
        found.append(("", table(("recording", "it takes", "expected separation", "tells them apart"), rows)))
        found.append(("", note(_NOTES["next"])))
    return found


def _responses(d: Diagnosis) -> "list[tuple[str, str | Figure]]":
    found: list[tuple[str, str | Figure]] = []
    drawn = curves(d)
    for kind, heading in (("receptance", "Receptance"), ("sensitivity", "Sensitivity")):
        if own := [c for c in drawn if c.kind == kind]:
            found.append((f"{heading}: measured, nominal, corrected", responses(own)))
            missing = " The nominal rig does not levitate and is not drawn." if d.gap.before is None else ""
            found.append(("", note(_NOTES["responses"] + missing)))
    return found


def _corrections(found: Sequence[Correction], d: Diagnosis) -> str:
    if not found:
        return note("Nothing was fitted: the corrected rig is the nominal one.")
    rig, rows = d.campaign.rig, []
    for c in found:
        limit = rig.tolerance.get(c.name)
        far = f", {number(abs(c.value) / limit, 2)} times exceeded" if limit and abs(c.value) > BEYOND * limit else ""
        rows.append((c.name, _typeset(str(c)), f"{100 * limit:.2g} %{far}" if limit else ""))
    return table(("parameter", "value or change", "stated tolerance"), rows)
