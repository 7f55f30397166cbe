"""A design of the estimator: console table, page and JSON."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.design.figures import AT_IN_D, LAG_IN_D, MARGIN_IN_D, responses, trade
from maglev_workbench.commands.selfsense.design.study import MARGINS, Candidate, Study, ideal_low_pass
from maglev_workbench.commands.selfsense.rig_sensor import made_by, reading_text, sampling_note
from maglev_workbench.page import note, number, page, table

if TYPE_CHECKING:
    import rich.table

_SAG = 0.02  # of the static gain lost at the lowest frequency: an integral part that is hardly there


def design_table(s: Study) -> "rich.table.Table":
    """The designs in 80 columns."""
    from rich import box
    from rich.table import Table

    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"{s.rig.name}: lag at {s.at / 1e3:g} kHz, droop below")
    head, rows = _cells(s)
    for name in head:
        result.add_column(name, justify="left" if not name else "right")
    for row in rows:
        result.add_row(*row)
    return result


def design_summary(s: Study) -> str:
    """Sentences on the wanted gains, their properties, and the dissertation's figures."""
    c = s.candidates[0]
    d = c.design
    noise = f", {number(1e6 * c.simulated_noise)} µm rms of noise" if np.isfinite(c.noise) else ""
    return (
        f"For at most {s.lag:g}° of lag at {s.at / 1e3:g} kHz within {s.droop:g} dB take kp = {d.kp:.4g} m/A and "
        f"ki = {d.ki:.4g} m/(A s): {number(d.phase_margin)}° of phase margin, {number(1e-3 * d.bandwidth)} kHz wide, "
        f"peak {number(d.peak)}{noise}. {_meaning(s)}"
    )


def design_json(s: Study) -> dict[str, Any]:
    """The designs as JSON data, schema maglev-selfsense-design/1, SI and degrees."""
    corner = s.sensor.estimator.path.low_pass
    designs = []
    for c in s.candidates:
        curves = {"response": _polar(c.frequency, c.response), "simulated": _polar(c.simulated_frequency, c.simulated)}
        one = {"name": c.name, "asked_lag": c.lag, "asked_droop": c.droop, **plain(c.design)}
        designs.append(one | {"noise": c.noise, "simulated_noise": c.simulated_noise, **curves})
    return plain(
        {
            "schema": "maglev-selfsense-design/1",
            "version": version("maglev-workbench"),
            "rig": s.rig.name,
            "sensor": s.sensor,
            "asked": {"lag": s.lag, "at": s.at, "droop": s.droop},
            "designs": designs,
            "left_out": s.missing,
            "trade_off": [{"droop": droop, "designs": found} for droop, found in s.trade.items()],
            "ideal_low_pass": {"phase_margin": MARGINS, "lag": ideal_low_pass(corner, s.at, MARGINS)},
            "dissertation": {"lag": LAG_IN_D, "phase_margin": MARGIN_IN_D, "at": AT_IN_D},
        }
    )


def design_page(s: Study) -> str:
    """The HTML of the designs."""
    head, rows = _cells(s)
    if np.isfinite(s.noise_density):
        price = (
            f"Noise: rms error of the gap from the reading ({reading_text(s.sensor)}), by the Cramér-Rao bound times "
            "the forward path's cost, and simulated on a moving gap. "
        )
    else:
        price = "This rig's current is read without noise and converter, so the gap has no noise. "
    text = (
        "Columns: largest lag and largest droop asked for; each has the most phase margin within both. "
        + price
        + "".join(f"Left out: {why}. " for why in s.missing)
        + sampling_note(s.sensor)
    )
    sections = [
        ("Designs", table(head, rows)),
        ("", note(text)),
        ("Estimated over true gap", responses(s)),
        ("", note(_response_note(s))),
        (f"Lag at {s.at / 1e3:g} kHz against phase margin, and its price", trade(s)),
        ("", note(_trade_note(s))),
    ]
    made = made_by(s.rig, s.sensor, **{"Designed for": f"{s.lag:g}° at {s.at:g} Hz within {s.droop:g} dB"})
    return page(f"Estimator design for {s.rig.name}", design_summary(s), sections, made)


def _cells(s: Study) -> tuple[list[str], list[list[str]]]:
    ranges = (
        ("kp, m/A", lambda c: number(c.design.kp, 4)),
        ("ki, m/(A s)", lambda c: _integral(c)),
        ("lag, °", lambda c: number(c.design.lag)),
        ("phase margin, °", lambda c: number(c.design.phase_margin)),
        ("gain margin", lambda c: number(c.design.gain_margin)),
        ("crossover, kHz", lambda c: number(1e-3 * c.design.crossover)),
        ("bandwidth, kHz", lambda c: number(1e-3 * c.design.bandwidth)),
        ("peak", lambda c: number(c.design.peak)),
        ("noise bandwidth, kHz", lambda c: number(1e-3 * c.design.noise_bandwidth)),
        ("noise by bound, µm rms", lambda c: number(1e6 * c.noise)),
        ("simulated, µm rms", lambda c: number(1e6 * c.simulated_noise)),
    )
    return ["", *(c.name.replace(", ", "\n") for c in s.candidates)], [
        [name, *map(of, s.candidates)] for name, of in ranges
    ]


def _polar(frequency: np.ndarray, response: np.ndarray) -> dict[str, np.ndarray]:
    return {"frequency": frequency, "magnitude": np.abs(response), "phase": np.degrees(np.unwrap(np.angle(response)))}


def _integral(c: Candidate) -> str:
    # A PI corner below 0.1 Hz has no practical effect.
    return number(c.design.ki, 4) if c.design.ki > 0.6 * c.design.kp else "≈ 0"


def _meaning(s: Study) -> str:
    """One sentence on why a small lag and a large phase margin exclude each other."""
    close, sagging = s.reference(20.0, 1.0), s.reference(20.0, 2.9)
    left = " of margin".join(f"{number(c.design.phase_margin, 2)}°" for c in (close, sagging) if c)
    if close and sagging:
        left = left.replace(" of margin", " of margin (") + " if the estimate may sag 2.9 dB)"
    elif left:
        left += " of margin" + (" if the estimate may sag 2.9 dB" if sagging else "")
    by_hand = _margin_by_hand(s)
    reached, before = bool(left), "band-pass" if s.sensor.estimator.path.rms else "high-pass"
    left = f"leave {left}" if reached else "are out of reach"
    return (
        f"With the exact sampled forward path 20° at {s.at / 1e3:g} kHz {left}"
        + (f", {'not' if reached else 'for all'} the {by_hand:.0f}° of the low-pass alone" if by_hand else "")
        + f", because the {before} delays the ripple's envelope and the estimate acts a sample late"
        + (
            f"; the dissertation's {LAG_IN_D:g}° of lag and {MARGIN_IN_D:g}° of margin belong to two designs"
            * _as_in_d(s)
        )
        + "."
    )


def _margin_by_hand(s: Study) -> float | None:
    """Phase margin (deg) with an ideal low-pass at 20 degrees of lag; None if it is outside MARGINS."""
    lags = ideal_low_pass(s.sensor.estimator.path.low_pass, s.at, MARGINS)
    return float(np.interp(20.0, lags, MARGINS)) if lags[0] < 20 < lags[-1] else None


def _as_in_d(s: Study) -> bool:
    return s.at == AT_IN_D


def _response_note(s: Study) -> str:
    slack = [c for c in s.candidates if abs(c.response[0]) < 1 - _SAG]
    return (
        "Lines: the linear model with the exact sampled forward path. Circles: simulated switching edge by switching "
        "edge, without noise; they lie on the lines. Less lag costs a higher peak. "
        + "".join(
            f"{c.name}: hardly an integral part is left, the estimate shows {abs(c.response[0]):.0%} of all but the "
            "slowest motion. "
            for c in slack
        )
        + f"Dotted: {s.at:g} Hz and the lag asked for. Shown up to half the PWM frequency: a faster motion cannot be "
        "told from its image below it."
    )


def _trade_note(s: Study) -> str:
    corner, by_hand = s.sensor.estimator.path.low_pass, _margin_by_hand(s)
    text = (
        "Curves: the smallest lag at every phase margin while the estimate stays within the droop; a curve ends where "
        f"no gains do. Dashed, by hand: a proportional controller around the ideal {corner / 1e3:g} kHz low-pass"
        + (f" would give 20° with {by_hand:.0f}° of margin. " if by_hand else ". ")
    )
    if _as_in_d(s):
        at_margin = float(ideal_low_pass(corner, s.at, np.array([MARGIN_IN_D]))[0])
        text += (
            f"The dissertation reads {LAG_IN_D:g}° of lag from a simulation (Fig. 6.14) and {MARGIN_IN_D:g}° of margin "
            "from a Bode plot of its circuit (Fig. 6.32), without gains. Both at once (x) lie below every curve: even "
            f"by hand {MARGIN_IN_D:g}° of margin lag {at_margin:.0f}°. "
        )
    if np.isfinite(s.noise_density):
        return text + "Below: rms error of the gap that this rig's noise and bits leave; circles simulated."
    return text + "Below: noise bandwidth."
