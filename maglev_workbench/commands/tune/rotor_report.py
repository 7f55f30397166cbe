"""A rotor's tuned gains as tables, figures and JSON: each requirement by speed, mode and plane, and its check."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from maglev_env.evaluation.goal_score import in_words, misses
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.goal import Goal, Requirement
from maglev_env.rotor.linear import sensitivity
from maglev_env.rotor.loop_quantities import TOGETHER, Found
from maglev_env.rotor.operating_point import by_direction
from maglev_env.rotor.requirements import worst
from maglev_workbench.commands.runup import figures as run_up_figures
from maglev_workbench.commands.runup.report import summary as run_up_summary
from maglev_workbench.commands.runup.study import Report
from maglev_workbench.page import COLOURS, STAR, note, number, styled, table

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

SHORT = {"plane a": "a", "plane b": "b", "translation": "transl.", TOGETHER: "all"}  # places in the tables by speed
BY_SPEED = "The worst at each speed: of plane a or b, of translation or tilt, or of all together; !: misses its limit."
MORE_COLOURS = ("#8a6d3b", "#5b5b9f", "#2a7f7f", "#b03a6b", "#777777", "#c7a500")
CHECK_HEAD = ("rpm", "controller", "peak |S|\nidentified", "peak |S|\nlinear model")


def head(goal: Goal) -> list[str]:
    """Columns of the tables by speed: the requirements with their units."""
    return ["rpm", *(f"{r.quantity.words}\n{r.quantity.shown[1]}".strip() for r in goal.measured)]


def speed_rows(goal: Goal, found: Mapping[str, Found]) -> list[list[str]]:
    """At each speed the worst value of each requirement, with its mode or plane, marked ! where it misses its limit."""
    speeds = sorted({v for r in goal.measured for v in found[r.name].speeds})
    return [[f"{v:g}", *(_cell(goal, r, found[r.name], v) for r in goal.measured)] for v in speeds]


def _cell(goal: Goal, r: Requirement, found: Found, speed: float) -> str:
    if speed not in found.speeds:
        return "–"
    i = found.speeds.index(speed)
    value, _, place = worst(Found((speed,), found.places, found.values[[i]]), r.name)
    if np.isnan(value):
        return "none"
    text = f"{number(value * r.quantity.shown[0])} {SHORT.get(place, place)}"
    if place == TOGETHER:  # which of them it is mainly
        single = [j for j, name in enumerate(found.places) if name != TOGETHER]
        own = Found((speed,), tuple(found.places[j] for j in single), found.values[[i]][:, single])
        one, _, at = worst(own, r.name)
        text += f", {SHORT.get(at, at)} {number(one * r.quantity.shown[0])}"
    return text + (" !" if r in goal.requirements and misses(r, np.array([value]))[0] > 0 else "")


def place_rows(goal: Goal, found: Mapping[str, Found]) -> list[list[str]]:
    """The worst of each requirement over the speeds, by mode and plane: requirement, place, value, rpm, verdict."""
    rows = []
    for r in goal.measured:
        own = found[r.name]
        for j, place in enumerate(own.places):
            value, speed, _ = worst(Found(own.speeds, (place,), own.values[:, [j]]), r.name)
            missed = r in goal.requirements and misses(r, np.array([value]))[0] > 0
            verdict = "" if r not in goal.requirements else "missed" if missed else "met"
            shown = (
                "none" if np.isnan(value) else f"{number(value * r.quantity.shown[0])} {r.quantity.shown[1]}".strip()
            )
            rows.append([in_words(r) if j == 0 else "", place, shown, f"{speed:g}", verdict])
    return rows


def terminal_table(goal: Goal, found: Mapping[str, Found]) -> Table:
    """`speed_rows` for a terminal."""
    made = Table(box=SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title="The recommended gains by speed")
    for i, name in enumerate(head(goal)):
        made.add_column(name, justify="left" if i else "right")
    for row in speed_rows(goal, found):
        made.add_row(*row)
    made.caption = BY_SPEED
    return made


def check_rows(checked: Report) -> list[list[str]]:
    """Peak sensitivity of each controller as identified in simulation beside the linear model's at the same lines."""
    one, rows = checked.identified, []
    for i, v in enumerate(checked.id_speeds):
        speed = v * np.pi / 30
        here = by_direction(checked.rotor, speed)
        for c, name in enumerate(checked.rotor.gains):
            # What turns sees the mean of x and y.
            both = [sensitivity(rotor, one.frequency[c], speed)[:, c, c] for rotor in here]
            model = abs(np.mean(both, axis=0)).max()
            rows.append([f"{v:g}", name, number(one.peak_sensitivity[i, c]), number(float(model))])
    return rows


def check_lines(checked: Report) -> Iterator["str | Table"]:
    """The check of the gains in simulation, for a terminal."""
    made = Table(box=SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title="Checked in simulation")
    for name in CHECK_HEAD:
        made.add_column(name, justify="right")
    for row in check_rows(checked):
        made.add_row(*row)
    yield made
    yield f"Simulated run-up: {run_up_summary(checked)}"


def sections(goal: Goal, found: Sequence[Mapping[str, Found]], checked: Report) -> "list[tuple[str, str | Figure]]":
    """Of the page: the recommended gains (first of found) by speed, by mode and plane, and in simulation."""
    return [
        ("Requirements over the speeds", over_speeds(goal, found)),
        ("", note("The worst mode or plane at each speed. Solid: the recommended gains; dotted: the rotor's own.")),
        ("By speed", table(head(goal), speed_rows(goal, found[0]))),
        ("", note(BY_SPEED)),
        ("By mode and plane", table(("requirement", "place", "worst", "at rpm", ""), place_rows(goal, found[0]))),
        ("The recommended gains in a simulated run-up", run_up_figures.run_up(checked)),
        ("", note(run_up_summary(checked))),
        ("Peak sensitivity, identified in simulation", table(CHECK_HEAD, check_rows(checked))),
        ("", note("Forward-rotating currents injected into one controller at a time while all loops are closed; both "
                  "columns at these lines.")),
    ]  # fmt: skip


def over_speeds(goal: Goal, found: Sequence[Mapping[str, Found]]) -> "Figure":
    """How much of each limit is used at each speed, by each of up to two gain sets."""
    from plotly.graph_objects import Figure

    figure, colours = Figure(), [*COLOURS, *MORE_COLOURS]
    for i, (one, dash) in enumerate(zip(found, ("solid", "dot"), strict=False)):
        for j, r in enumerate(goal.requirements):
            if not one:
                continue
            own = one[r.name]
            used = [
                float(np.exp(misses(r, np.array([worst(Found((v,), own.places, own.values[[k]]), r.name)[0]]))[0]))
                for k, v in enumerate(own.speeds)
            ]
            figure.add_scatter(
                x=own.speeds, y=used, name=r.quantity.words, legendgroup=r.name, showlegend=i == 0,
                mode="lines+markers", line={"color": colours[j % len(colours)], "dash": dash},
            )  # fmt: skip
    figure.add_hline(1.0, line={"color": STAR, "width": 2})
    figure.update_xaxes(title_text="speed in rpm")
    figure.update_yaxes(title_text="share of the limit that is used", rangemode="tozero")
    return styled(figure, 460)


def found_json(found: Mapping[str, Found]) -> dict[str, Any]:
    """Every quantity in SI at every speed (rpm) and place; None where it has no value or no bound."""
    return plain(
        {name: {"speeds": one.speeds, "places": one.places, "values": one.values} for name, one in found.items()}
    )
