"""The figures of a benchmark on the console and as a page, compared with those of an earlier run."""

from typing import TYPE_CHECKING

from rich.table import Table

from maglev_workbench.commands.bench.figures import TOLERANCE, Change, Results, changes, differences
from maglev_workbench.console import console
from maglev_workbench.page import COLOURS, note, number, page, styled, table

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_SIMULATORS = ("dlsim", "forced_response", "solve_ivp")


def show(results: Results, old: Results | None) -> None:
    """Print every figure, and with an earlier run its value, the ratio and whether the new one is worse."""
    found = changes(old, results) if old else {}
    grid = Table(title="maglev bench: hmb_free (x-y: hmb_radial), 6 s at 20 kHz")
    for heading in _head(old):
        grid.add_column(heading, justify="left" if heading in ("figure", "unit") else "right")
    for row in _rows(results, old, found):
        grid.add_row(*row)
    console.print(grid)
    for line in _remarks(results, old, found):
        console.print(line)


def bench_page(results: Results, old: Results | None) -> str:
    """HTML of the figures: simulators, parts of an evaluation and estimators drawn, everything in a table."""
    found = changes(old, results) if old else {}
    value = {name: figure.value for name, figure in results.figures.items()}
    simulators = {"this simulator": 1 / value["experiments_per_second_and_core"]}
    simulators |= {name: value[f"{name}_seconds"] for name in _SIMULATORS if f"{name}_seconds" in value}
    parts = {
        name.removeprefix("share_").removesuffix("_ms"): v
        for name, v in value.items()
        if name.startswith("share_") and name.endswith("_ms")
    }
    estimators = {
        name.removesuffix("_ms"): figure.value
        for name, figure in results.figures.items()
        if name.endswith("_ms") and not name.startswith(("share_", "evaluation_"))
    }
    remarks = "".join(note(line) for line in _remarks(results, old, found))
    sections = [
        ("Simulators", _bars(simulators, "seconds per experiment of 6 s and core", True)),
        ("Parts of an evaluation", _bars(parts, "milliseconds per gain set and core", False)),
        ("Estimators", _bars(estimators, "milliseconds per gain set, recording or design, and core", True)),
        ("All figures", remarks + table(_head(old), _rows(results, old, found))),
    ]
    made = {"Measured": results.date, "Processor": results.processor, "Cores": results.cores, **results.versions}
    if old:
        made["Compared with"] = old.date
    summary = f"{value['gain_sets_per_second']:.0f} gain sets per second."
    return page("Benchmark", summary, sections, made)


def _head(old: Results | None) -> tuple[str, ...]:
    return ("figure", "value", "unit", *(("old", "new / old", "") if old else ()))


def _rows(results: Results, old: Results | None, found: dict[str, Change]) -> list[tuple[str, ...]]:
    rows = []
    for name, figure in results.figures.items():
        row = (name.replace("_", " "), number(figure.value), figure.unit)
        if old:
            change = found.get(name)
            row += (
                (number(change.old), number(change.ratio), "worse" if change.worse else "")
                if change
                else ("–", "–", "")
            )
        rows.append(row)
    return rows


def _remarks(results: Results, old: Results | None, found: dict[str, Change]) -> list[str]:
    """Remarks on a comparison: how many figures are worse, and differences other than the code."""
    if not old:
        return []
    worse = sum(change.worse for change in found.values())
    lines = [f"{worse} of {len(found)} figures that both runs have are worse by more than {TOLERANCE - 1:.0%}"]
    if others := differences(old, results):
        lines.append(f"warning: not only the code differs: {'; '.join(others)}")
    return lines


def _bars(values: dict[str, float], title: str, log: bool) -> "Figure":
    import plotly.graph_objects as go

    names = [name.replace("_", " ") for name in values]
    figure = go.Figure(go.Bar(x=list(values.values()), y=names, orientation="h", marker_color=COLOURS[0]))
    figure.update_xaxes(title_text=title, **({"type": "log", "dtick": 1, "exponentformat": "power"} if log else {}))
    figure.update_yaxes(autorange="reversed")
    return styled(figure, 130 + 26 * len(values))
