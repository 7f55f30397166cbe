"""Reports of x-y identification by `maglev estimate`: JSON, a terminal table, and sections of the page."""

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.planar import CONDITION_LIMIT
from maglev_env.identification import NORMAL_95
from maglev_env.identification_planar import PlanarIdentification
from tuning.estimate_figures import COEFFICIENTS
from tuning.estimate_report import MISFIT, POOR_FIT, ROWS
from tuning.page import facts, note, number, plain, table, with_interval
from tuning.planar_figures import ELEMENTS, SUMS, SYMBOLS, coefficient_matrix, row_sum_panels

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

_BAND = "band\nHz"


def planar_json(files: str, found: PlanarIdentification) -> dict[str, Any]:
    """The eight coefficients as JSON data, SI; what is missing, unbounded or not to be told apart is None.

    Coefficients are {xx, xy, yx, yy}, force axis first, each {value, se, ci}. condition and inflation None: infinite.
    row_sums: one entry per recording, in the order of files; ratio {re, im} is y / x of the motion they hold for.
    """
    bands = [_json_band(found, b) for b in range(len(found.bands))]
    return plain({"files": files, "masses": found.masses, "bands": bands, "notes": found.notes})


def planar_table(found: PlanarIdentification) -> "rich.table.Table":
    """Bands for a terminal, at most 30 rows: blocks of stiffness, of damping and, with a support, of the bearing.

    Bands where x and y move along one line have no coefficients but the row sums of the first recording, last.
    """
    from rich import box
    from rich.table import Table

    known, sums = found.estimate.identifiable, found.row_sums[0]
    per_band = max(len(_blocks(found)), 1 if known.all() or not known.any() else 2)
    step = -(-len(known) * per_band // ROWS)
    shown = range(0, len(known), step)
    blocks = []
    for name in _blocks(found):
        some = [b for b in shown if known[b] or name == "stiffness"]
        blocks.append((_head(name), [(_cells(found, name, b), _style(found, b)) for b in some]))
    refused = [b for b in shown if not known[b]]
    if refused:
        rows = [
            (_sum_cells(found, 0, b), "" if sums.x.informative[b] and sums.y.informative[b] else "dim") for b in refused
        ]
        blocks.append((_sum_head(), rows))
    result = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), caption_justify="left")
    for i, name in enumerate(blocks[0][0]):
        result.add_column(name, justify="right", no_wrap=i in (0, 5))
    for i, (head, rows) in enumerate(blocks):
        if i:
            result.add_row()
            result.add_row(*head, style="bold")
        for cells, style in rows:
            result.add_row(*cells, style=style)
    legend = _legend(found, {style for _, rows in blocks for _, style in rows})
    if step > 1:
        legend.append(f"One band in {step} of {len(known)} is shown; the page and the JSON hold all.")
    result.caption = "\n".join(legend)
    return result


def planar_sections(files: str, found: PlanarIdentification) -> "list[tuple[str, str | Figure]]":
    """Sections of the page for `tuning.page.page`: summary, figures, tables and notes."""
    known = found.estimate.identifiable
    sections: list[tuple[str, str | Figure]] = [(f"x and y together: {files}", facts(_facts(found)))]
    if known.any():
        for name in COEFFICIENTS:
            sections.append((f"{name.capitalize()} of x and y, {files}", coefficient_matrix(found, name)))
        text = "Above: force along x, below: along y; left: per motion along x, right: along y. Bars: 95 %, to the "
        text += "panel's edge and beyond where unbounded. Hollow: the data do not bound all eight. Crosses: least squares."
        grey = "" if known.all() else " Grey: x and y move along one line, and the eight cannot be told apart."
        sections.append(("", note(text + grey)))
        sections.append(("", _coefficient_table(found)))
        if found.bearing_stiffness is not None:
            head = _head("bearing")[:-1]
            rows = [_cells(found, "bearing", b)[:-1] for b in np.flatnonzero(known)]
            sections.append((f"Bearing alone, {files}", table(head, rows)))
            sections.append(("", note("Total less the rig's support, which is taken as known.")))
    if not known.all():
        sections += _sum_sections(files, found)
    notes = "".join(f"<li>{escape(text)}</li>" for text in found.notes)
    return [*sections, (f"Notes on {files}", f"<ul>{notes}</ul>")] if notes else sections


def _json_band(found: PlanarIdentification, b: int) -> dict[str, Any]:
    ml, ls, known = found.estimate, found.least_squares, found.estimate.identifiable[b]
    entry: dict[str, Any] = {"f_lo": found.bands[b, 0], "f_hi": found.bands[b, 1]}
    entry |= {
        name: getattr(ml, name)[b] for name in ("condition", "identifiable", "informative", "fit_p", "noise_share")
    }
    entry["inflation"] = {name: _by_element(getattr(ml, f"{name}_inflation")[b]) for name in COEFFICIENTS}
    squares: dict[str, Any] = {
        "r2_adjusted": dict(zip("xy", ls.r2_adjusted[b] if known else (None, None), strict=True))
    }
    for name in COEFFICIENTS:
        value, se, low, high = (getattr(ml, f"{name}{end}")[b] for end in ("", "_se", "_low", "_high"))
        entry[name] = _by_element(value, se, low, high)
        bearing = getattr(found, f"bearing_{name}")
        support = None if bearing is None else value - bearing[b]
        entry[f"bearing_{name}"] = (
            None if bearing is None else _by_element(bearing[b], se, low - support, high - support)
        )
        # A fit to motion along one line is a fit to its noise.
        value, se = (getattr(ls, f"{name}{end}")[b] + (0.0 if known else np.nan) for end in ("", "_se"))
        squares[name] = _by_element(value, se, value - NORMAL_95 * se, value + NORMAL_95 * se)
    return entry | {"least_squares": squares, "row_sums": [_json_sums(found, r, b) for r in range(len(found.row_sums))]}


def _by_element(value: np.ndarray, *rest: np.ndarray) -> dict[str, Any]:
    """Matrices (2, 2) by element: of values alone, or of value, standard error, low and high."""
    if not rest:
        return {name: value[at] for name, at in ELEMENTS.items()}
    se, low, high = rest
    return {name: {"value": value[at], "se": se[at], "ci": [low[at], high[at]]} for name, at in ELEMENTS.items()}


def _json_sums(found: PlanarIdentification, recording: int, b: int) -> dict[str, Any]:
    sums = found.row_sums[recording]
    entry: dict[str, Any] = {}
    for axis in "xy":
        own = getattr(sums, axis)
        entry[axis] = {}
        for name in COEFFICIENTS:
            entry[axis] |= {name: getattr(own, name)[b]}
            entry[axis] |= {f"{name}_ci": [getattr(own, f"{name}_{end}")[b] for end in ("low", "high")]}
    ratio = {"re": sums.ratio[b].real, "im": sums.ratio[b].imag}
    return entry | {"ratio": ratio, "ratio_spread": sums.ratio_spread[b]}


def _blocks(found: PlanarIdentification) -> list[str]:
    """Blocks of a terminal's table."""
    if not found.estimate.identifiable.any():
        return []
    return [*COEFFICIENTS, *(["bearing"] if found.bearing_stiffness is not None else [])]


def _head(block: str) -> list[str]:
    if block == "bearing":
        direct = [
            f"{SYMBOLS[name]}_{element}\n{unit}" for name, (_, unit) in COEFFICIENTS.items() for element in ("xx", "yy")
        ]
        return [_BAND, *direct, "bearing\nalone"]
    unit = COEFFICIENTS[block][1]
    last = "condition\nnumber" if block == "stiffness" else "\ntrust"
    return [_BAND, *(f"{SYMBOLS[block]}_{element}\n{unit}" for element in ELEMENTS), last]


def _cells(found: PlanarIdentification, block: str, b: int) -> list[str]:
    if block == "bearing":
        direct = [_coefficient(found, name, b, (i, i), True) for name in COEFFICIENTS for i in range(2)]
        return [_band(found, b), *direct, ""]
    last = number(found.estimate.condition[b]) if block == "stiffness" else _trust(found, b)
    return [_band(found, b), *(_coefficient(found, block, b, at) for at in ELEMENTS.values()), last]


def _band(found: PlanarIdentification, b: int) -> str:
    return "{:.4g}–{:.4g}".format(*found.bands[b])


def _coefficient(found: PlanarIdentification, name: str, b: int, at: tuple[int, int], bearing: bool = False) -> str:
    ml, scale = found.estimate, COEFFICIENTS[name][0]
    values = np.array([getattr(ml, f"{name}{end}")[b][at] for end in ("", "_low", "_high")])
    if bearing:
        values -= values[0] - getattr(found, f"bearing_{name}")[b][at]
    return with_interval(*scale * values)


def _trust(found: PlanarIdentification, b: int) -> str:
    if not found.estimate.identifiable[b]:
        return "one line"
    if not found.estimate.informative[b]:
        return "unbounded"
    misfit = found.estimate.fit_p[b] < MISFIT and found.least_squares.r2_adjusted[b].min() < POOR_FIT
    return "poor fit" if misfit else "good"


def _style(found: PlanarIdentification, b: int) -> str:
    return {"good": "", "poor fit": "yellow"}.get(_trust(found, b), "dim")


def _legend(found: PlanarIdentification, styles: set[str]) -> list[str]:
    known = found.estimate.identifiable
    texts = ["±, [ ]: 95 %."]
    if "dim" in styles:
        texts[0] += " Dim: the data do not bound it all."
    if "yellow" in styles:
        texts[0] += " Yellow: constant coefficients do not fit."
    if known.any() and found.bearing_stiffness is not None:
        texts.append("Bearing alone: total less the rig's support.")
    if not known.all():
        where = f"Condition number above {CONDITION_LIMIT:g}" if known.any() else "In every band"
        texts.append(f"{where}: x and y move along one line, y = r x; only sums along it are known.")
    return texts


def _sum_head() -> list[str]:
    return [
        _BAND,
        *(f"{text.format(SYMBOLS[n])}\n{unit}" for n, (_, unit) in COEFFICIENTS.items() for text in SUMS),
        "\nr = y / x",
    ]


def _sum_cells(found: PlanarIdentification, recording: int, b: int) -> list[str]:
    sums = found.row_sums[recording]
    cells = []
    for name, (scale, _) in COEFFICIENTS.items():
        for own in (sums.x, sums.y):
            ends = (scale * getattr(own, f"{name}{end}")[b] for end in ("", "_low", "_high"))
            cells.append(with_interval(*ends))
    return [_band(found, b), *cells, _ratio(sums.ratio[b])]


def _ratio(ratio: complex) -> str:
    """r = y / x: a number where x and y move in step or against each other, else magnitude and angle."""
    size, angle = abs(ratio), np.degrees(np.angle(ratio))
    if not np.isfinite(size) or min(abs(angle), 180 - abs(angle)) < 1:
        return number(float(np.real(ratio)))
    return f"{number(size)} ∠{angle:.0f}°"


def _facts(found: PlanarIdentification) -> list[tuple[str, str]]:
    ml, known = found.estimate, found.estimate.identifiable
    summary = f"{known.sum()} of {len(known)} bands tell the eight coefficients apart"
    if known.any():
        summary += f", {(ml.informative & known).sum()} of them bound all eight"
    rows = [("Summary", summary + "."), ("Mass", "x {} kg, y {} kg".format(*(number(m, 4) for m in found.masses)))]
    if known.any():
        low, high = ml.condition[known].min(), ml.condition[known].max()
        text = f"{number(low)} to {number(high)} where told apart; {CONDITION_LIMIT:g} the most allowed"
        rows.append(("Condition number", text))
    return rows


def _coefficient_table(found: PlanarIdentification) -> str:
    head = [*_head("stiffness")[:-1], *_head("damping")[1:-1], "condition\nnumber", "adjusted R2\nx, y", "\ntrust"]
    rows = []
    for b in range(len(found.bands)):
        *stiffness, condition = _cells(found, "stiffness", b)
        _, *damping, trust = _cells(found, "damping", b)
        r2 = found.least_squares.r2_adjusted[b] if found.estimate.identifiable[b] else (None, None)
        rows.append([*stiffness, *damping, condition, ", ".join(number(value) for value in r2), trust])
    return table(head, rows)


def _sum_sections(files: str, found: PlanarIdentification) -> "list[tuple[str, str | Figure]]":
    """Row sums of the bands where x and y move along one line; with a figure where that is every band."""
    known = found.estimate.identifiable
    names = files.split(" + ")
    if len(names) != len(found.row_sums):
        names = [f"recording {i + 1}" for i in range(len(found.row_sums))]
    where = "every band" if not known.any() else "the bands below"
    why = (
        f"In {where} x and y move along one line, y = r x, or noise hides that they do not: what x and what y add to the "
        "force cannot be told apart there, only their sum along the line. To get all eight coefficients, record again "
        "with the excitation turned, 90 degrees best, or drive x and y on lines of their own"
    )
    why += "; if that was done, record longer or louder." if len(names) > 1 else "."
    if found.bearing_stiffness is not None:
        why += " The sums include the rig's support."
    sections: list[tuple[str, str | Figure]] = [(f"Row sums, {files}", note(why))]
    if not known.any():
        sections.append(("", row_sum_panels(found, names)))
        text = "Bars: 95 %, to the panel's edge and beyond where unbounded. Hollow: the data do not bound the estimate."
        sections.append(("", note(text)))
    for recording, name in enumerate(names):
        rows = [_sum_cells(found, recording, b) for b in np.flatnonzero(~known)]
        sections.append((name if len(names) > 1 else "", table(_sum_head(), rows)))
    return sections
