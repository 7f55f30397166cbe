"""The lowest stable sampling rate: console table, page and JSON."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.design.figures import LAG_IN_D, MARGIN_IN_D
from maglev_workbench.commands.selfsense.rate_limit.figures import rate_map
from maglev_workbench.commands.selfsense.rate_limit.rate_map import (
    AT,
    CLAIMED,
    REFUSED,
    Gains,
    RateMap,
    as_predicted,
)
from maglev_workbench.commands.selfsense.rig_sensor import DISSERTATION_RATE, made_by, sampling_note
from maglev_workbench.page import note, number, page, table
from selfsense.design import LEAST_MARGIN

if TYPE_CHECKING:
    import rich.table

_SETTLES = {True: "settles", False: "swings", None: "–"}


def rate_table(m: RateMap) -> "rich.table.Table":
    """The named gains in 80 columns."""
    from rich import box
    from rich.table import Table

    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"{m.rig.name}: lowest stable sampling rate")
    head, rows = _cells(m)
    for i in _NARROW:
        result.add_column(head[i], justify="right" if i else "left")
    for row in rows:
        result.add_row(*(row[i] for i in _NARROW))
    return result


def rate_summary(m: RateMap) -> str:
    """Sentences on the lowest rate of the rig's design, and on the dissertation's 165 kHz."""
    own, *others = m.designs
    close = next((g for g in others if g.asked_lag == 20), None)
    text = f"The rig's own gains are stable {_from(own)}" + (f", those for 20° of lag {_from(close)}" if close else "")
    if not m.limits:
        return f"{text}. At {CLAIMED / 1e3:g} kHz this supply cannot be sampled: the dissertation's limit has no place."
    limits = m.limits.values()
    margins, in_d = (_range(np.concatenate([getattr(x, name) for x in limits])) for name in ("margin", "margin_in_d"))
    rate = m.sensor.acquisition.rate
    text += (
        f". Gains that stop at {CLAIMED / 1e3:g} kHz, as the dissertation reports of its own, lie close to the "
        f"stability limit: {margins} of phase margin at {rate / 1e3:g} kHz"
        + (f" ({in_d} at {DISSERTATION_RATE / 1e3:g} kHz)" if rate != DISSERTATION_RATE else "")
    )
    lag = m.limits[CLAIMED].lag
    if np.nanmin(lag) < LAG_IN_D < np.nanmax(lag):
        text += f"; among them are some with its {LAG_IN_D:g}° of lag at {AT / 1e3:g} kHz, but none with its "
        text += f"{MARGIN_IN_D:g}° of margin"
    wide = max((g for g in others if g.design), key=lambda g: g.design.phase_margin, default=None)
    if wide:
        text += f". With {number(wide.design.phase_margin, 2)}° of margin {wide.lowest / 1e3:g} kHz are enough"
    return text + "."


def rate_json(m: RateMap) -> dict[str, Any]:
    """The map as JSON data, schema maglev-selfsense-rate-limit/1, SI and degrees."""
    return plain(
        {
            "schema": "maglev-selfsense-rate-limit/1",
            "version": version("maglev-workbench"),
            "rig": m.rig.name,
            "sensor": m.sensor,
            "path_gain": m.gain,
            "rates": m.rates,
            "map": {"kp": m.kp, "ki": m.ki, "order": "[kp][ki]", "lowest": m.lowest},
            "limits": list(m.limits.values()),
            "designs": [_one(g) for g in m.designs],
            "claimed": [_one(g) for g in m.claimed],
            "simulated": [_one(g) for g in m.checks],
        }
    )


def rate_page(m: RateMap) -> str:
    """The HTML of the map."""
    head, rows = _cells(m)
    agree = sum(map(as_predicted, m.checks))
    text = (
        "Lowest rate: from there on every rate is stable, in steps of a fifth of the PWM frequency"
        f" ({m.rates[0] / 1e3:g} to {m.rates[-1] / 1e3:g} kHz searched). Margin, lag and peak: at the rig's rate. "
        "Simulated: from four gaps all over the range, edge by edge, at the lowest rate and one step below it; swings: "
        "the estimate runs from end to end of its range, as it may within a few percent of the limit from a wrong gap "
        "even where small errors die out. " + sampling_note(m.sensor)
    )
    around = (
        f"Colour: the lowest stable rate; grey: not stable at {m.rates[-1] / 1e3:g} kHz either. "
        + (
            f"Red: the gains up to which {CLAIMED / 1e3:g} kHz (solid) and {REFUSED / 1e3:g} kHz (dotted) are stable: "
            f"the dissertation's simulation ran at {CLAIMED / 1e3:g} and failed at {REFUSED / 1e3:g} kHz (7.2, point "
            "6), so its gains, which it does not give, lie between the two. "
            if m.limits
            else ""
        )
        + f"Circles: {agree} of {len(m.checks)} points simulated agree with the map. The path's gain is "
        f"{m.gain:.4g} A/m. Stable is not useful: below {LEAST_MARGIN:g}° of "
        "margin the estimate rings, and at slow rates edges between samples make it ripple."
    )
    sections = [
        ("Gains and their lowest rate", table(head, rows)),
        ("", note(text)),
        ("Lowest stable sampling rate over kp and ki", rate_map(m)),
        ("", note(around)),
    ]
    made = made_by(m.rig, m.sensor, **{"Map": f"{m.kp.size} x {m.ki.size}, logarithmic"})
    return page(f"Sampling rates of the estimator of {m.rig.name}", rate_summary(m), sections, made)


_NARROW = (0, 3, 4, 5, 8, 9)


def _cells(m: RateMap) -> tuple[list[str], list[list[str]]]:
    head = [
        "gains",
        "kp\nm/A",
        "ki\nm/(A s)",
        "PI corner\nkHz",
        "lowest\nkHz",
        "margin\n°",
        f"lag at {AT / 1e3:g} kHz\n°",
    ]
    head += ["peak", "simulated", "one step\nbelow"]
    rows = []
    for g in (*m.designs, *m.claimed):
        d = g.design
        brought = [number(v) if d else "–" for v in ((d.phase_margin, d.lag, d.peak) if d else (None,) * 3)]
        gains = [number(g.kp, 4), number(g.ki, 4), number(1e-3 * g.ki / (2 * np.pi * g.kp))]
        lowest = f"{g.lowest / 1e3:g}" if np.isfinite(g.lowest) else f"> {m.rates[-1] / 1e3:g}"
        rows.append([g.name, *gains, lowest, *brought, *(_SETTLES[s] for s in g.settles)])
    return head, rows


def _one(g: Gains) -> dict[str, Any]:
    settles = dict(zip(("at_lowest", "one_step_below"), g.settles, strict=True))
    return {
        "name": g.name,
        "asked_lag": g.asked_lag,
        "kp": g.kp,
        "ki": g.ki,
        "lowest": g.lowest,
        "design": g.design,
        "settles": settles,
    }


def _from(g: Gains) -> str:
    return f"from {g.lowest / 1e3:g} kHz on" if np.isfinite(g.lowest) else "at no rate up to the rig's"


def _range(margins: np.ndarray) -> str:
    low, high = np.nanmin(margins), np.nanmax(margins)
    return f"{max(low, 0):.0f} to {high:.0f}°"
