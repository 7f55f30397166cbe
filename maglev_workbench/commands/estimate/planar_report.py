"""Reports of x-y identification by `maglev estimate`: JSON, a terminal table, and sections of the page."""

from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from estimation.xy.planar import CONDITION_LIMIT
from maglev_env.evaluation.identification_planar import PlanarIdentification
from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.estimate.figures import COEFFICIENTS
from maglev_workbench.commands.estimate.planar_figures import (
    ELEMENTS,
    SUMS,
    SYMBOLS,
    coefficient_matrix,
    planar_units,
    row_sum_panels,
)
from maglev_workbench.commands.estimate.report import MISFIT, POOR_FIT, ROWS
from maglev_workbench.page import facts, html_text, note, number, table, with_interval

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

_BLOCKS = {
    "stiffness": [("stiffness", element) for element in ELEMENTS],
    "damping": [("damping", element) for element in ELEMENTS],
    "bearing": [(name, element) for name in COEFFICIENTS for element in ("xx", "yy")],
}
_LAST = {"stiffness": "condition\nnumber", "damping": "\ntrust", "bearing": "bearing\nalone"}


def planar_json(files: str, found: PlanarIdentification) -> dict[str, Any]:
    """The eight coefficients as JSON data, SI; missing, unbounded or indistinguishable values are None.

    Coefficients are {xx, xy, yx, yy}, force axis first, each {value, se, ci}. A condition or inflation of None means
    infinite. row_sums has one entry per recording, in the order of files; its ratio {re, im} is y / x of the motion for
    which the sums hold.
    """
    bands = [_json_band(found, b) for b in range(len(found.bands))]
    return plain({"files": files, "masses": found.masses, "bands": bands, "notes": found.notes})


def planar_table(found: PlanarIdentification) -> "rich.table.Table":
    """Table of the bands for a terminal, with at most 30 rows in each block.

    The blocks are stiffness, damping and, with a support, the bearing alone. Bands in which x and y move along one line
    have no coefficients; the last block gives their row sums by the first recording.
    """
    from rich import box
    from rich.table import Table

    known, names = found.estimate.identifiable, _blocks(found)
    step = -(-len(known) * max(1, len(names)) // ROWS)
    shown = range(0, len(known), step)
    blocks = []
    for name in names:
        some = [b for b in shown if known[b] or name == "stiffness"]
        if some:
            blocks.append((_head(found, name), [(_cells(found, name, b), _style(found, b)) for b in some]))
    sure = found.row_sums[0].x.informative & found.row_sums[0].y.informative
    sums = [(_sum_cells(found, 0, b), "" if sure[b] else "dim") for b in shown if not known[b]]
    if sums:
        heads = [name.replace(" + ", "\n+ ") for name in _sum_head(found)]
        blocks.append((["\n" * (2 - name.count("\n")) + name for name in heads], sums))
    result = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), caption_justify="left")
    for i, name in enumerate(blocks[0][0]):
        result.add_column(name, justify="right", no_wrap=i in (0, 5))
    for i, (head, rows) in enumerate(blocks):
        if i:
            result.add_row()
            result.add_row(*head, style="bold")
        for cells, style in rows:
            result.add_row(*cells, style=style)
    legend = _legend(found, {style for _, rows in blocks for _, style in rows}, bool(sums))
    if step > 1:
        legend.append(f"One band in {step} of {len(known)} is shown; the page and the JSON hold all.")
    result.caption = "\n".join(legend)
    return result


def planar_sections(files: str, found: PlanarIdentification) -> "list[tuple[str, str | Figure]]":
    """Sections of the page for `maglev_workbench.page.page`: summary, figures, tables and notes."""
    known, names = found.estimate.identifiable, _blocks(found)
    sections: list[tuple[str, str | Figure]] = [(f"x and y together: {files}", facts(_facts(found)))]
    if names:
        text = (
            "Above: force along x, below: along y; left: per motion along x, right: along y. Bars: 95 %, to the "
            "panel's edge and beyond where unbounded. Hollow: the data do not bound all eight. Crosses: least squares."
        )
        text += "" if known.all() else " Grey: the eight cannot be told apart; see the row sums."
        sections.append(("", note(text)))
    for name in names:
        if name == "bearing":
            rows = [_cells(found, name, b)[:-1] for b in np.flatnonzero(known)]
            sections.append((f"Bearing alone, {files}", note("Total less the rig's support, which is taken as exact.")))
            sections.append(("", _foldable(_head(found, name)[:-1], rows)))
        else:
            head, rows = _head(found, name), [_cells(found, name, b) for b in range(len(known))]
            if name == "damping":
                head.append("adjusted R2\nx, y")
                for cells, r2, told in zip(rows, found.least_squares.r2_adjusted, known, strict=True):
                    cells.append(", ".join(number(value) for value in r2) if told else "–")
            sections.append((f"{name.capitalize()} of x and y, {files}", coefficient_matrix(found, name)))
            sections.append(("", _foldable(head, rows)))
    if not known.all():
        sections += _sum_sections(files, found)
    notes = "".join(f"<li>{html_text(text)}</li>" for text in found.notes)
    return [*sections, (f"Notes on {files}", f"<ul>{notes}</ul>")] if notes else sections


def _json_band(found: PlanarIdentification, b: int) -> dict[str, Any]:
    ml, ls, known = found.estimate, found.least_squares, found.estimate.identifiable[b]
    kept = ("condition", "identifiable", "informative", "fit_p", "noise_share")
    entry: dict[str, Any] = {"f_lo": found.bands[b, 0], "f_hi": found.bands[b, 1]}
    entry |= {name: getattr(ml, name)[b] for name in kept}
    r2 = ls.r2_adjusted[b] if known else (None, None)
    squares: dict[str, Any] = {"r2_adjusted": dict(zip("xy", r2, strict=True))}
    inflation = {}
    for name in COEFFICIENTS:
        value, se, low, high = (getattr(ml, f"{name}{end}")[b] for end in ("", "_se", "_low", "_high"))
        entry[name], entry[f"bearing_{name}"] = _by_element(value, se, low, high), None
        if found.bearing_stiffness is not None:
            bearing = getattr(found, f"bearing_{name}")[b]
            support = value - bearing
            entry[f"bearing_{name}"] = _by_element(bearing, se, low - support, high - support)
        inflation[name] = {element: getattr(ml, f"{name}_inflation")[b][at] for element, at in ELEMENTS.items()}
        # Least squares on motion along one line fits the noise across it.
        value, se = (np.where(known, getattr(ls, f"{name}{end}")[b], np.nan) for end in ("", "_se"))
        squares[name] = _by_element(value, se, value - NORMAL_95 * se, value + NORMAL_95 * se)
    row_sums = [_json_sums(found, recording, b) for recording in range(len(found.row_sums))]
    return entry | {"inflation": inflation, "least_squares": squares, "row_sums": row_sums}


def _by_element(value: np.ndarray, se: np.ndarray, low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    return {name: {"value": value[at], "se": se[at], "ci": [low[at], high[at]]} for name, at in ELEMENTS.items()}


def _json_sums(found: PlanarIdentification, recording: int, b: int) -> dict[str, Any]:
    sums = found.row_sums[recording]
    entry: dict[str, Any] = {"x": {}, "y": {}}
    for axis, own in (("x", sums.x), ("y", sums.y)):
        for name in COEFFICIENTS:
            ends = [getattr(own, f"{name}_{end}")[b] for end in ("low", "high")]
            entry[axis] |= {name: getattr(own, name)[b], f"{name}_ci": ends}
    ratio = {"re": sums.ratio[b].real, "im": sums.ratio[b].imag}
    return entry | {"ratio": ratio, "ratio_spread": sums.ratio_spread[b]}


def _blocks(found: PlanarIdentification) -> list[str]:
    """The blocks of the eight coefficients that can be tabulated."""
    if not found.estimate.identifiable.any():
        return []
    return [name for name in _BLOCKS if name != "bearing" or found.bearing_stiffness is not None]


def _head(found: PlanarIdentification, block: str) -> list[str]:
    units = planar_units(found)
    names = [f"{SYMBOLS[name]}_{element}\n{units[name][1]}" for name, element in _BLOCKS[block]]
    return ["band\nHz", *names, _LAST[block]]


def _cells(found: PlanarIdentification, block: str, b: int) -> list[str]:
    cells, units = [], planar_units(found)
    for name, element in _BLOCKS[block]:
        at = (b, *ELEMENTS[element])
        values = np.array([getattr(found.estimate, f"{name}{end}")[at] for end in ("", "_low", "_high")])
        if block == "bearing":
            values -= values[0] - getattr(found, f"bearing_{name}")[at]
        cells.append(with_interval(*units[name][0] * values))
    last = {"stiffness": number(found.estimate.condition[b]), "damping": _trust(found, b), "bearing": ""}
    return ["{:.4g}–{:.4g}".format(*found.bands[b]), *cells, last[block]]


def _trust(found: PlanarIdentification, b: int) -> str:
    if not found.estimate.identifiable[b]:
        return "one line"
    if not found.estimate.informative[b]:
        return "unbounded"
    misfit = found.estimate.fit_p[b] < MISFIT and found.least_squares.r2_adjusted[b].min() < POOR_FIT
    return "poor fit" if misfit else "good"


def _style(found: PlanarIdentification, b: int) -> str:
    return {"good": "", "poor fit": "yellow"}.get(_trust(found, b), "dim")


def _legend(found: PlanarIdentification, styles: set[str], refused: bool) -> list[str]:
    known = found.estimate.identifiable
    texts = ["±, [ ]: 95 %."]
    if "dim" in styles:
        texts[0] += " Dim: the data do not bound all of it."
    if "yellow" in styles:
        texts[0] += " Yellow: constant coefficients do not fit."
    if known.any() and found.bearing_stiffness is not None:
        texts.append("Bearing alone: total less the rig's support.")
    if refused:
        where = f"Condition number above {CONDITION_LIMIT:g}" if known.any() else "In every band"
        whose = ", here the first recording's" if found.row_sums[1:] else ""
        texts.append(
            f"{where}: x and y move along one line, y = r x, or noise hides that they do not; only sums along it are "
            f"known{whose}."
        )
    return texts


def _sum_head(found: PlanarIdentification) -> list[str]:
    units = planar_units(found).items()
    names = [f"{text.format(SYMBOLS[name])}\n{unit}" for name, (_, unit) in units for text in SUMS]
    return ["band\nHz", *names, "\nr = y / x"]


def _sum_cells(found: PlanarIdentification, recording: int, b: int) -> list[str]:
    sums = found.row_sums[recording]
    cells = []
    for name, (scale, _) in planar_units(found).items():
        for own in (sums.x, sums.y):
            cells.append(with_interval(*(scale * getattr(own, f"{name}{end}")[b] for end in ("", "_low", "_high"))))
    return ["{:.4g}–{:.4g}".format(*found.bands[b]), *cells, _ratio(sums.ratio[b])]


def _ratio(ratio: complex) -> str:
    """y / x as text: a real number if x and y move in phase or in antiphase, else magnitude and angle."""
    size, angle = abs(ratio), np.degrees(np.angle(ratio))
    turned = np.isfinite(size) and 1 <= abs(angle) <= 179
    value = size if turned else ratio.real
    text = f"{value:.2f}" if 0.1 <= abs(value) < 100 else number(value)
    return f"{text} ∠{angle:.0f}°" if turned else text


def _foldable(head: list[str], rows: list[list[str]]) -> str:
    """HTML of a table; a long one is folded."""
    html = table(head, rows)
    return html if len(rows) <= ROWS else f"<details><summary>Table of {len(rows)} bands</summary>{html}</details>"


def _facts(found: PlanarIdentification) -> list[tuple[str, str]]:
    ml, known = found.estimate, found.estimate.identifiable
    summary = f"{known.sum() or 'none'} of {len(known)} bands tell the eight coefficients apart"
    if known.any():
        summary += f", {(ml.informative & known).sum()} bound all eight"
    rows = [("Summary", summary), ("Mass", "x {} kg, y {} kg".format(*(number(m, 4) for m in found.masses)))]
    if known.any():
        low, high = ml.condition[known].min(), ml.condition[known].max()
        text = f"{number(low)} to {number(high)} where told apart; {CONDITION_LIMIT:g} the most allowed"
        rows.append(("Condition number", text))
    return rows


def _sum_sections(files: str, found: PlanarIdentification) -> "list[tuple[str, str | Figure]]":
    """Row sums of the bands in which x and y move along one line, with a figure if these are all bands."""
    known = found.estimate.identifiable
    names = files.split(" + ")
    if len(names) != len(found.row_sums):
        names = [f"recording {i + 1}" for i in range(len(found.row_sums))]
    where = "the bands below" if known.any() else "every band"
    why = (
        f"In {where} x and y move along one line, y = r x, or noise hides that they do not. What motion along x and "
        "motion along y add to the force cannot be told apart there, only their sum. To get all eight coefficients, "
        "record again with the excitation turned, 90 degrees best, or drive x and y on lines of their own"
    )
    why += "; if that was done, record longer or louder." if len(names) > 1 else "."
    why += " Where r has an angle, stiffness sums hold a share of the cross damping, and the other way round."
    if found.bearing_stiffness is not None:
        why += " The sums include the rig's support."
    sections: list[tuple[str, str | Figure]] = [(f"Row sums, {files}", note(why))]
    if not known.any():
        sections.append(("", row_sum_panels(found, names)))
        text = "Bars: 95 %, to the panel's edge and beyond where unbounded. Hollow: the data do not bound the estimate."
        sections.append(("", note(text)))
    for recording, name in enumerate(names):
        rows = [_sum_cells(found, recording, b) for b in np.flatnonzero(~known)]
        sections.append((name if len(names) > 1 else "", _foldable(_sum_head(found), rows)))
    return sections
