"""A fit's own figures and what it leaves, in words."""

from collections.abc import Mapping, Sequence

from estimation.normal import NORMAL_95
from maglev_env.loop.effect import EFFECTS
from sim2real.gap.fit_figures import Figures
from sim2real.gap.leftover import Leftover, Share
from sim2real.gap.locate import ALL_DRIVEN
from sim2real.words import Fitted, fitted_quantity, percent, quantity, spoken

SHOWN, LEAST = 3, 0.05  # shares that are listed, and the least of them
UNEVEN = 2.0  # times its even share that a segment must hold to be named
LITTLE = 0.05  # share of the missing force's power that a curve over a quantity describes, which says nothing of it
CLEAR = 3.0  # mean square of a profile, in its standard errors, from which the missing force goes with a quantity


def fit_in_words(fit: Figures) -> str:
    """ "chi-square 1.04 per degree of freedom, residual 0.61 µm rms, 99.8 % of the motion predicted"."""
    return (
        f"chi-square {fit.chi_square:.3g} per degree of freedom, residual {quantity(fit.residual_rms, None, 'm')} rms, "
        f"{100 * max(fit.predicted, 0.0):.4g} % of the motion predicted"
    )


def partial_in_words(left: Leftover) -> str:
    """The best partial explanation with 95 % intervals: "friction, force 0.05 +- 0.01 N (95 %)"."""
    if not left.effects:
        return "calibration alone"
    names = " with ".join(left.effects)
    return f"{names}, {parameters_in_words(left.parameters, left.effects)}"


def parameters_in_words(parameters: Mapping[str, Fitted], named: Sequence[str]) -> str:
    """Parameters of effects with 95 % intervals; those within tolerance are left out.

    Each has the name of its effect, unless that alone is named.
    """
    found = []
    for name, at in parameters.items():
        effect, _, key = name.partition(".")
        if key:
            text = fitted_quantity(at, EFFECTS[effect].parameters[key].unit, key == "change", NORMAL_95)
            found.append(f"{spoken(name, list(named) != [effect])} {text}")
    told = any(at["se"] for name, at in parameters.items() if "." in name)
    return ", ".join(found) + (" (95 %)" if told else "")


def moved_in_words(left: Leftover) -> str:
    """Parameters that calibration has moved clearly, in brackets; empty where effects are the explanation."""
    moved = [
        f"{name.partition(' ')[0]} {quantity(at['value'], NORMAL_95 * at['se'], '', True)}"
        for name, at in left.parameters.items()
        if "." not in name and at["se"] is not None and abs(at["value"]) > NORMAL_95 * at["se"]
    ]
    if left.effects:
        return ""
    return f" ({', '.join(moved)}; 95 %)" if moved else " (no parameter moves clearly)"


def leaves(left: Leftover) -> str:
    """How much it leaves, as the end of a sentence."""
    if left.share is not None:
        return f"leaves {percent(min(max(left.share, 0.0), 1.0))} of the gap"
    if left.figures is not None:
        return f"leaves {fit_in_words(left.figures)}"
    return "does not levitate on the recordings that judge"


def leftover_lines(left: Leftover) -> list[str]:
    """What the best partial explanation leaves: how much, in which channel, block, band, recording, time and shape."""
    figures = "" if left.figures is None or left.share is None else f": {fit_in_words(left.figures)}"
    lines = [f"Best partial explanation: {partial_in_words(left)}{moved_in_words(left)}. It {leaves(left)}{figures}."]
    blocks = {name.replace("+", " + "): share for name, share in left.where.blocks.items()}
    bands = {f"{lo:.3g} .. {hi:.3g} Hz": share for lo, hi, share in left.where.bands}
    kind = _listed(left.where.kind) if left.where.between else ALL_DRIVEN
    lines.append(f"What is left by channel: {_listed(left.channels)}; by block: {_listed(blocks)}; "
                 f"by band: {_listed(bands)}; by kind of line: {kind}"
                 f"{f'; by axis: {_listed(left.where.axes)}' if left.where.axes else ''}.")  # fmt: skip
    own = [
        f"{r.name} ({quantity(r.motion, None, 'm')} rms) {percent(r.share)}" + (f", {_when(r)}" if r.share else "")
        for r in left.recordings
    ]
    if any(r.share for r in left.recordings):
        lines.append(f"By recording, the largest motion first: {'; '.join(own)}.")
    elif own:
        lines.append("Over all its lines, no recording is left with more than noise.")
    if left.profiles:
        best = max(left.profiles, key=lambda p: p.clear)
        told = ", ".join(f"{p.quantity} {percent(p.share)}" for p in left.profiles)
        told_apart = best.clear > CLEAR and best.share > LITTLE
        what = f"goes most clearly with the {best.quantity}" if told_apart else "goes with no single quantity"
        lines.append(f"The force that the simulation lacks {what} (share of its power that a curve over it describes: "
                     f"{told}).")  # fmt: skip
    return lines


def _listed(shares: Mapping[str, float]) -> str:
    ordered = sorted(shares.items(), key=lambda item: -item[1])[:SHOWN]
    listed = ", ".join(f"{name} {percent(share)}" for name, share in ordered if share >= LEAST)
    return listed or ("spread evenly" if any(shares.values()) else "none stands out of the noise")


def _when(r: Share) -> str:
    """In which part of a recording its residual is large, in words."""
    loud = [s for s in r.segments if s[2] > UNEVEN / len(r.segments)]
    if not r.segments:
        return "time not told"
    if not loud:
        return "evenly over time"
    return "most of it at " + ", ".join(f"{a:.3g} .. {b:.3g} s ({percent(share)})" for a, b, share in loud)
