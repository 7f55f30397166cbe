"""A goal in tables, figures and JSON: each requirement against its limit, and the two quantities that conflict."""

from collections.abc import Mapping, Sequence
from math import ceil, isfinite, isinf
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.evaluation.goal_score import FAR, in_words, met, misses
from maglev_env.evaluation.requirements import LOOP
from maglev_env.rig.goal import Goal, Requirement
from maglev_workbench.page import COLOURS, INFEASIBLE, STAR, labelled_axis, number, styled, with_interval

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

BETWEEN = "between_lines_"  # of what the simulated loop has there, beside that
PREFIX = "required_"  # of a quantity's name in the columns of a sweep and in the info of an experiment
HEAD = ("requirement", "value", "limit", "")
CUT = 3.0  # times the limit, where a bar ends
EN_SPACE, WIDTH = "\u2002", 85  # so many of them are as wide as one limit
SHORT = 0.4  # of the limit, up to which a bar has its value beside it
ONE_OF_PAIR, OTHER = "compliance", "noise_current"  # conflict, and are measured whatever the goal is


def values_of(row: Mapping[str, Any], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Quantities (n,) of a row of columns (a number, or an array (n,)), by name; nan where there is none."""
    return {name: np.atleast_1d(np.asarray(row.get(PREFIX + name, np.nan), dtype=float)) for name in names}


def shown_names(goal: Goal) -> tuple[str, ...]:
    """Quantities whose values every experiment has."""
    return tuple(dict.fromkeys([*(r.name for r in goal.measured), ONE_OF_PAIR, OTHER]))


def requirement_rows(goal: Goal, row: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of HEAD for one gain set, whose columns have the prefix; what is only made best has no limit."""
    return [(_words(r), value_in_words(r, row), _limit(goal, r), _verdict(goal, r, row)) for r in goal.measured]


def missed_in_words(goal: Goal, row: Mapping[str, Any]) -> str:
    """The requirements that a gain set misses, or that it meets them all."""
    lacking = [r for r in goal.requirements if _missed(r, row) > 0]
    if not lacking:
        return "meets every requirement"
    return "misses " + "; ".join(f"{in_words(r)} ({value_in_words(r, row)})" for r in lacking)


def standing(goal: Goal, row: Mapping[str, Any]) -> tuple[str, str]:
    """How many requirements a gain set meets, and the one that is missed most or met with the least reserve."""
    if not goal.requirements or PREFIX + goal.requirements[0].name not in row:
        return "–", "–"
    by = [_missed(r, row) for r in goal.requirements]
    if not row.get("feasible", True):
        return f"0 of {len(by)}", "touchdown" if isfinite(row.get("touchdown_time", np.nan)) else "unstable"
    worst = goal.requirements[int(np.argmax(by))]
    return f"{sum(one <= 0 for one in by)} of {len(by)}", f"{worst.quantity.words} {value_in_words(worst, row)}"


def requirements_json(goal: Goal, row: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Every quantity of one gain set in SI, with its limit and whether that is met."""
    return {
        r.name: {
            "value": row.get(PREFIX + r.name),
            "low": row.get(f"{PREFIX}{r.name}_low"),
            "high": row.get(f"{PREFIX}{r.name}_high"),
            "limit": r.limit if r in goal.requirements else None,
            "at": r.at,
            "met": bool(_missed(r, row) <= 0) if r in goal.requirements else None,
        }
        for r in goal.measured
    }


def requirement_bars(goal: Goal, sets: Sequence[tuple[str, Mapping[str, Any]]]) -> "Figure":
    """How much of each limit some gain sets use: a bar that ends left of 1 is met.

    Args:
        goal: the goal.
        sets: names and columns of up to three gain sets.
    """
    import plotly.graph_objects as go

    labels = [in_words(r) for r in goal.requirements]
    figure, widest = go.Figure(), 1.3
    for (name, row), colour in zip(sets, COLOURS, strict=False):
        used = np.array([float(np.exp(_missed(r, row))) for r in goal.requirements])
        widest = max(widest, min(used.max() * 1.1, CUT))
        ends = np.array([_ends(r, row) for r in goal.requirements])
        # The value of a short bar stands beside it, behind the end of its interval.
        behind = [
            EN_SPACE * ceil(WIDTH * (high - one)) if one <= SHORT else ""
            for one, (_, high) in zip(used, ends, strict=True)
        ]
        text = [space + value_in_words(r, row) for space, r in zip(behind, goal.requirements, strict=True)]
        spread = {"type": "data", "symmetric": False, "array": ends[:, 1] - used, "arrayminus": used - ends[:, 0]}
        spread |= {end: np.where(spread[end] > 0, spread[end], None) for end in ("array", "arrayminus")}
        spread |= {"color": "#444", "thickness": 1.5}
        figure.add_bar(
            y=labels, x=np.minimum(used, CUT), orientation="h", name=name, marker={"color": colour}, text=text,
            textposition=["inside" if share > SHORT else "outside" for share in used], insidetextanchor="start",
            textangle=0, error_x=spread, cliponaxis=False,
            hovertemplate="%{y}: %{x:.3g} of the limit<extra></extra>",
        )  # fmt: skip
    figure.add_vline(1.0, line={"color": STAR, "width": 2})
    figure.add_annotation(x=1.0, y=1.0, yref="paper", yanchor="bottom", text="limit", showarrow=False)
    figure.update_xaxes(title_text="share of the limit that is used<br>(at least: limit over value)", range=[0, widest])
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_layout(barmode="group", legend={"orientation": "h", "x": 0, "y": 1.01, "yanchor": "bottom"})
    return styled(figure, 130 + 34 * len(labels) * max(1, len(sets)))


def front(goal: Goal, values: Mapping[str, np.ndarray], feasible: np.ndarray) -> np.ndarray:
    """Whether no other set is at least as good in both quantities of `pair_of`, among those that may be used, (n,)."""
    first, second = (_cost(r, values[r.name]) for r in pair_of(goal))
    may = np.flatnonzero(feasible & np.isfinite(first) & np.isfinite(second))
    order = may[np.lexsort((second[may], first[may]))]
    before = np.minimum.accumulate(np.concatenate([[np.inf], second[order]]))[:-1]
    found = np.zeros(len(first), bool)
    found[order[second[order] < before]] = True
    return found


def pair_of(goal: Goal) -> tuple[Requirement, Requirement]:
    """The two quantities of the front: what is made best, and the noise current; the compliance if that is best."""
    by_name = {r.name: r for r in goal.measured}
    first = goal.best.name if goal.best and goal.best.name != OTHER else ONE_OF_PAIR
    one, other = (by_name.get(name) or Requirement(name, 1.0) for name in (first, OTHER))
    return one, other


def front_figure(
    goal: Goal,
    values: Mapping[str, np.ndarray],
    feasible: np.ndarray,
    best: int | None,
    hover: Sequence[str],
    marked: str = "best",
) -> "Figure":
    """The two quantities of `pair_of` of every stable gain set, their front, and the limits.

    Args:
        goal: the goal.
        values: (n,) by name.
        feasible: (n,), whether the loop is stable and never touched down.
        best: index of the set to mark.
        hover: texts of the sets.
        marked: what the marked set is called.
    """
    import plotly.graph_objects as go

    pair = pair_of(goal)
    x, y = (values[r.name] * r.quantity.shown[0] for r in (pair[1], pair[0]))
    meets = feasible & met(goal, values)
    figure = go.Figure()
    for some, name, colour in (
        (feasible & ~meets, "misses a requirement", "#999999"),
        (meets, "meets all", COLOURS[2]),
    ):
        marker = {"color": colour, "size": 7, "opacity": 0.8}
        figure.add_scatter(x=x[some], y=y[some], mode="markers", name=name, marker=marker, text=np.array(hover)[some])
    for some, name, dash in ((feasible, "front of all", "dot"), (meets, "front of those that meet all", "solid")):
        line = np.flatnonzero(front(goal, values, some))
        line = line[np.argsort(x[line])]
        if line.size > 1:
            figure.add_scatter(
                x=x[line], y=y[line], mode="lines", name=name, line={"color": COLOURS[1], "dash": dash, "shape": "hv"}
            )
    if best is not None:
        star = {"symbol": "star", "size": 16, "color": STAR, "line": {"color": "white", "width": 1.5}}
        figure.add_scatter(x=[x[best]], y=[y[best]], mode="markers", name=marked, marker=star)
    limits = {r.name: r.limit * r.quantity.shown[0] for r in goal.requirements}
    for r, draw in ((pair[1], figure.add_vline), (pair[0], figure.add_hline)):
        if r.name in limits:
            draw(limits[r.name], line={"color": INFEASIBLE, "dash": "dash", "width": 2})
    for r, update in ((pair[1], figure.update_xaxes), (pair[0], figure.update_yaxes)):
        scale, unit = r.quantity.shown
        shown = values[r.name][feasible & np.isfinite(values[r.name]) & (values[r.name] > 0)] * scale
        update(**labelled_axis(r.quantity.words + (f" in {unit}" if unit else ""), shown, log=shown.size > 0))
    return styled(figure, 460)


def _missed(r: Requirement, row: Mapping[str, Any]) -> float:
    """As `misses`, also between the lines; an unstable loop misses everything, whatever its growing motion reads."""
    if not row.get("feasible", True):
        return float(np.log(FAR))
    read = float(misses(r, values_of(row, (r.name,))[r.name])[0])
    hidden = _hidden(r, row)
    return read if hidden is None else max(read, float(misses(r, np.array([hidden]))[0]))


def _hidden(r: Requirement, row: Mapping[str, Any]) -> float | None:
    """What the loop has between the lines, where they do not show it."""
    value = row.get(BETWEEN + r.name)
    return None if value is None or not isfinite(value) else float(value)


def _ends(r: Requirement, row: Mapping[str, Any]) -> tuple[float, float]:
    """The interval of a quantity as shares of its limit; the share itself where there is none."""
    own = _missed(r, row)
    found = [row.get(f"{PREFIX}{r.name}_{end}") for end in ("low", "high")]
    shares = [own if v is None or not isfinite(v) or v <= 0 else float(misses(r, np.array([v]))[0]) for v in found]
    low, high = (float(np.exp(share)) for share in sorted([*shares, own])[::2])
    return min(low, CUT), min(high, CUT)


def _cost(r: Requirement, value: np.ndarray) -> np.ndarray:
    return value if r.quantity.most else -value


def _words(r: Requirement) -> str:
    return r.quantity.words


def value_in_words(r: Requirement, row: Mapping[str, Any], shown: tuple[float, str] | None = None) -> str:
    """A quantity of one gain set with its interval; shown: factor from SI and unit, by default those of tables."""
    scale, unit = shown or r.quantity.shown
    hidden = _hidden(r, row)
    if hidden is None:
        return _read_in_words(r, row, scale, unit)
    # The interval goes as far as what is hidden, which says less than that itself.
    read = _read_in_words(r, {PREFIX + r.name: row.get(PREFIX + r.name)}, scale, unit)
    return f"{read}, {f'{number(hidden * scale)} {unit}'.rstrip()} between the lines"


def _read_in_words(r: Requirement, row: Mapping[str, Any], scale: float, unit: str) -> str:
    value = row.get(PREFIX + r.name)
    if value is None or not isfinite(value):
        if r.name not in LOOP:
            return "touchdown"
        return "below the lines" if value is not None and isinf(value) else "not within the lines"
    low, high = (row.get(f"{PREFIX}{r.name}_{end}") for end in ("low", "high"))
    ends = [None if end is None or np.isnan(end) else end * scale for end in (low, high)]
    text = number(value * scale) if ends == [None, None] else with_interval(value * scale, *ends)
    return f"{text} {unit}".rstrip()


def _limit(goal: Goal, r: Requirement) -> str:
    if r not in goal.requirements:
        return "as good as possible"
    scale, unit = r.quantity.shown
    text = f"{'at most' if r.quantity.most else 'at least'} {r.limit * scale:.4g} {unit}".rstrip()
    return text + (", then best" if goal.best and goal.best.name == r.name else "")


def _verdict(goal: Goal, r: Requirement, row: Mapping[str, Any]) -> str:
    return "" if r not in goal.requirements else "met" if _missed(r, row) <= 0 else "missed"
