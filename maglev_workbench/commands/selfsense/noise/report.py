"""Gap noise against bits and current noise: console table, page and JSON."""

from collections.abc import Iterable, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.noise.figures import LIMIT, converter, record, sweep
from maglev_workbench.commands.selfsense.noise.study import FREQUENCY, REACH, NoiseStudy
from maglev_workbench.commands.selfsense.rig_sensor import DISSERTATION_RATE, made_by, reading_text, sampling_note
from maglev_workbench.page import note, number, page, table
from selfsense.bound import NoisePoint

if TYPE_CHECKING:
    import rich.table

_COARSE = 1 / 8  # share of the peak-to-peak ripple; a larger count gives a rounding error that repeats every period
_LOST = 0.2  # share of the gap; with a larger rms error the estimate reaches the limits of its range


def noise_table(s: NoiseStudy) -> "rich.table.Table":
    """Errors in µm in 80 columns."""
    from rich import box
    from rich.table import Table

    title = f"{s.rig.name}: gap error in µm rms over noise of the reading"
    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=title, caption="*: above twice the bound")
    for name in ("bits", *(f"{1e3 * n:g} mA" for n in s.noises)):
        result.add_column(name, justify="right")
    for bits in s.bits:
        result.add_row(converter(bits), *(_short(s, s.at(bits, n)) for n in s.noises))
    return result


def noise_summary(s: NoiseStudy) -> str:
    """Sentences on the error with the rig's own reading, and on where and why it is far above the bound."""
    where = f"at the estimator's noise bandwidth of {s.bandwidth / 1e3:.3g} kHz"
    if s.own:
        text = (
            f"At the rig's own {reading_text(s.sensor)}, the gap errs by {number(1e6 * s.own.rms)} µm rms {where}: "
            f"{s.own.ratio:.2f} times the Cramér-Rao bound, of which the forward path costs {s.cost:.3g}. "
        )
    else:
        text = (
            "The rig's current is read without noise and converter. "
            f"The forward path by itself costs {s.cost:.3g} times the bound. "
        )
    rate = s.sensor.acquisition.rate
    runs = [(rate, s.points)] + ([(DISSERTATION_RATE, s.at_dissertation)] if s.at_dissertation else [])
    above, most = [], []
    for at, points in runs:
        held = [p for p in points if not _lost(s, p)]
        if not held:
            continue
        if far := sorted({p.bits for p in held if p.ratio > LIMIT}):
            above.append(f"with {_words(far)} bits at {at / 1e3:g} kHz (up to {_largest(held).ratio:.2g})")
        most.append(f"{_largest(held).ratio:.2f} with {converter(_largest(held).bits)} at {at / 1e3:g} kHz")
    text += (
        f"The error exceeds twice the bound {' and '.join(above)}. "
        if above
        else f"It nowhere exceeds twice the bound (most: {', '.join(most)}). "
    )
    return text + _why(s)


def noise_json(s: NoiseStudy) -> dict[str, Any]:
    """The errors as JSON data, schema maglev-selfsense-noise/1, SI."""

    def rows(points: Iterable[NoisePoint]) -> list[dict[str, Any]]:
        return [plain(p) | {"ratio": p.ratio, "lost": _lost(s, p)} for p in points]

    return plain(
        {
            "schema": "maglev-selfsense-noise/1",
            "version": version("maglev-workbench"),
            "rig": s.rig.name,
            "sensor": s.sensor,
            "seed": s.seed,
            "motion": {"amplitude": REACH * s.sensor.gap, "frequency": FREQUENCY},
            "noise_bandwidth": s.bandwidth,
            "forward_path_cost": s.cost,
            "ripple_peak_to_peak": s.ripple,
            "own": rows([s.own])[0] if s.own else None,
            "points": rows(s.points),
            "dissertation_rate": {"rate": DISSERTATION_RATE, "points": rows(s.at_dissertation)},
            "record": s.record,
        }
    )


def noise_page(s: NoiseStudy) -> str:
    """The HTML of the errors."""
    head = ["bits", *(f"{1e3 * n:g} mA" for n in s.noises)]
    rows = [[converter(b), *(_cell(s, s.at(b, n)) for n in s.noises)] for b in s.bits]
    text = (
        "Columns: noise of the current reading, rms. Error: rms deviation of the estimated gap from that of a reading "
        "without noise and converter, in µm; in brackets over the Cramér-Rao bound at the estimator's noise bandwidth. "
        f"The gap moves by {1e6 * REACH * s.sensor.gap:.3g} µm at {FREQUENCY:g} Hz. "
    )
    if any(_lost(s, p) for p in s.points):
        text += f"Lost: above {_LOST:.0%} of the gap, the estimate runs into the ends of its range. "
    sections = [
        ("Gap error against bits and noise", table(head, rows)),
        ("", note(text + sampling_note(s.sensor))),
        ("Error and bound", sweep(s)),
        ("", note("Solid: simulated. Dashed: the bound, with the converter's error taken for white noise.")),
        ("Converter alone", table(*_converters(s))),
        ("", note(_converter_note(s))),
        ("A period of the moving gap at the rig's own noise and bits", record(s)),
        (
            "",
            note(
                "Black (white on a dark screen): "
                "lag and ripple of the estimate alone; blue less black is the noise, inside the dashed lines "
                "95 % of the time if it reached the bound."
            ),
        ),
    ]
    made = made_by(s.rig, s.sensor, **{"Seed": s.seed})
    return page(f"Gap noise of {s.rig.name}", noise_summary(s), sections, made)


def _converters(s: NoiseStudy) -> tuple[list[str], list[list[str]]]:
    runs = [(s.sensor.acquisition.rate, {b: s.at(b, 0.0) for b in s.bits if b})]
    if s.at_dissertation:
        runs.append((DISSERTATION_RATE, {p.bits: p for p in s.at_dissertation}))
    head = ["bits", "count\nmA", "counts in\nthe ripple"]
    for rate, _ in runs:
        head += [f"{name}\n{rate / 1e3:g} kHz" for name in ("error, µm", "mean, µm", "ratio")]
    rows = []
    for bits in runs[0][1]:
        count = 2 * s.sensor.acquisition.current_range / 2**bits
        row = [str(bits), number(1e3 * count), number(s.ripple / count)]
        for _, points in runs:
            p = points.get(bits)
            row += [number(1e6 * p.rms), number(1e6 * p.bias, 2), f"{p.ratio:.2f}"] if p else ["–"] * 3
        rows.append(row)
    return head, rows


def _converter_note(s: NoiseStudy) -> str:
    return (
        f"Without noise. The ripple is {number(s.ripple)} A from peak to peak, the converter spans "
        f"±{s.sensor.acquisition.current_range:g} A. Mean: what no average over the motion takes away."
    )


def _why(s: NoiseStudy) -> str:
    a = s.sensor.acquisition
    coarse = [b for b in s.bits if b and 2 * a.current_range / 2**b > _COARSE * s.ripple]
    if not coarse:
        return ""
    share = 2 * a.current_range / 2 ** max(coarse) / s.ripple
    return (
        f"With {max(coarse)} bits and fewer a count is {share:.0%} of the ripple or more: the same counts come back "
        "every PWM period, an error that is no white noise, that no average takes away and that no bound for white "
        "noise describes; the narrower the estimator, the further above it. Noise of half a count makes it white."
    )


def _cell(s: NoiseStudy, p: NoisePoint | None) -> str:
    return f"{_short(s, p).rstrip('*')} ({p.ratio:.2f})" if p and not _lost(s, p) else _short(s, p)


def _short(s: NoiseStudy, p: NoisePoint | None) -> str:
    if p is None:
        return "–"
    return "lost" if _lost(s, p) else number(1e6 * p.rms) + "*" * (p.ratio > LIMIT)


def _lost(s: NoiseStudy, p: NoisePoint) -> bool:
    return bool(p.rms > _LOST * s.sensor.gap)


def _largest(points: Sequence[NoisePoint]) -> NoisePoint:
    return max(points, key=lambda p: p.ratio)


def _words(bits: Sequence[int]) -> str:
    return " and ".join([", ".join(map(str, bits[:-1])), str(bits[-1])]) if len(bits) > 1 else str(bits[0])
