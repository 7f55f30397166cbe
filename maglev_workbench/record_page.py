"""A page on recordings for a first look: one period over time, and every line with its noise."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
import scipy
from plotly.subplots import make_subplots

from estimation.lines.periods import line_statistics, period_spectra, split_periods
from maglev_env.channels import MEASURED
from maglev_env.loop.gains import GAIN_CARDS, unit_of_gain
from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.rig.excitation import Excitation
from maglev_workbench.page import COLOURS, labelled_axis, number, page, styled

if TYPE_CHECKING:
    import xarray as xr

_SHOWN = {"m": (1e6, "µm"), "N": (1.0, "N"), "A": (1.0, "A")}
_LABELS = {"speed_rpm": "Speed, rpm"}
_STRETCHES = 500  # of a panel over time, of each of which the smallest and the largest sample are drawn
_PER_DECADE = 100  # bands of a spectrum, of each of which the lowest and the highest line are drawn
_PARTS = 8  # of a recording in which nothing repeats: the length of what Welch averages


def record_page(
    title: str,
    recordings: Sequence[tuple[str, "xr.Dataset"]],
    answer: str = "",
    first: Sequence[tuple[str, str]] = (),
) -> str:
    """HTML of recordings (name, dataset as `read_recording` gives it), after an answer and sections of its own."""
    sections: list[tuple[str, str | go.Figure]] = [*first]
    for name, dataset in recordings:
        if _repeats(dataset):
            sections += [
                (f"{name}: last period", _time(dataset)),
                (f"{name}: lines and their noise", _spectra(dataset)),
            ]
        else:
            sections += [(f"{name}: over time", _time(dataset)), (f"{name}: spectral density", _density(dataset))]
    alarms = [f"{name}: {alarm.sentence}." for name, dataset in recordings for alarm in alarms_of(dataset)]
    return page(title, " ".join(filter(None, [answer, *alarms, _extent(recordings)])), sections, _made_by(recordings))


def _extent(recordings: "Sequence[tuple[str, xr.Dataset]]") -> str:
    """How many recordings there are, and how far the rotor and the currents go in them."""
    peaks: dict[str, str] = {}
    for kind in ("displacement", "current"):
        own = [d[name] for _, d in recordings for name in _channels(d) if _kind(name) == kind]
        if own:
            factor, unit = _SHOWN.get(own[0].attrs.get("units", ""), (1.0, own[0].attrs.get("units", "")))
            peaks[kind] = f"{number(factor * max(float(np.nanmax(np.abs(one.values))) for one in own))} {unit}"
    reach = ", ".join(f"{kind} up to {peak}" for kind, peak in peaks.items())
    return f"{len(recordings)} recording(s)" + (f": {reach}." if reach else ".")


def _made_by(recordings: "Sequence[tuple[str, xr.Dataset]]") -> dict[str, str]:
    made_by = {"Recordings": ", ".join(name for name, _ in recordings)}
    if not recordings:
        return made_by
    first = json.loads(recordings[0][1].attrs.get("experiment", "{}"))
    for name in ("rig", "gains", "effects", "sensor", "speed_rpm", "seed", "version"):
        value = first.get(name)
        if isinstance(value, dict):
            value = ", ".join(f"{key} {_with_unit(key, value)}" for key in value)
        if value not in (None, ""):
            made_by[_LABELS.get(name, name.capitalize())] = f"{value:g}" if isinstance(value, float) else f"{value}"
    return made_by


def _with_unit(name: str, among: Mapping[str, object]) -> str:
    """A value of some of the experiment, a gain with its SI unit."""
    value = among[name]
    known = isinstance(value, float) and name in GAIN_CARDS
    return f"{value:g} {unit_of_gain(name, (n for n in among if n in GAIN_CARDS))}".strip() if known else f"{value}"


def _channels(dataset: "xr.Dataset") -> list[str]:
    shown = (n for n in dataset.data_vars if _kind(n) in MEASURED)
    return sorted(shown, key=lambda n: (MEASURED.index(_kind(n)), n))


def _kind(channel: str) -> str:
    return channel.partition("_")[0]


def _samples_per_period(dataset: "xr.Dataset") -> int:
    excitations = json.loads(dataset.attrs["experiment"]).get("excitations") or []
    periodic = [one for one in (Excitation(**e) for e in excitations) if one.periodic]
    return periodic[0].block(dataset.attrs["sample_rate"])[0] if periodic else dataset.sizes["time"]


def _repeats(dataset: "xr.Dataset") -> bool:
    """Whether a period is stated and the recording holds two of them, so that noise can be told from them."""
    return 2 * _samples_per_period(dataset) <= dataset.sizes["time"]


def _density(dataset: "xr.Dataset") -> go.Figure:
    """Spectral densities by Welch's method: where nothing repeats, signal and noise are not told apart."""
    names, rate = _channels(dataset), dataset.attrs["sample_rate"]
    length = max(dataset.sizes["time"] // _PARTS, 16)
    figure = make_subplots(rows=len(names), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, name in enumerate(names, 1):
        factor, unit = _unit(dataset, name)
        f, power = scipy.signal.welch(dataset[name].values, rate, nperseg=length, detrend="linear")
        density = factor * np.sqrt(power[1:])
        drawn = _of_bands(f[1:], density)
        line = {"width": 1, "color": COLOURS[0]}
        figure.add_scatter(x=f[1:][drawn], y=density[drawn], row=row, col=1, name=name, line=line)
        figure.update_yaxes(title_text=f"{name}, {unit}/√Hz", type="log", exponentformat="power", row=row, col=1)
    figure.update_xaxes(**labelled_axis("", f[1:], log=True)).update_xaxes(
        title_text="frequency, Hz", row=len(names), col=1
    )
    return styled(figure, 200 * len(names) + 80).update_layout(showlegend=False)


def _unit(dataset: "xr.Dataset", name: str) -> tuple[float, str]:
    """Factor from SI, and the unit that is shown."""
    si = dataset[name].attrs.get("units", "")
    return _SHOWN.get(si, (1.0, si))


def _time(dataset: "xr.Dataset") -> go.Figure:
    names, per_period = _channels(dataset), _samples_per_period(dataset)
    figure = make_subplots(rows=len(names), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    time = dataset["time"].values[-per_period:]
    stretch = np.arange(len(time)) * _STRETCHES // len(time)
    for row, name in enumerate(names, 1):
        factor, unit = _unit(dataset, name)
        values = dataset[name].values[-per_period:] * factor
        drawn = _extremes(values, stretch)
        figure.add_scatter(x=time[drawn], y=values[drawn], row=row, col=1, name=name, line={"width": 1})
        figure.update_yaxes(title_text=f"{name}, {unit}", row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=len(names), col=1)
    return styled(figure, 180 * len(names) + 80).update_layout(showlegend=False)


def _spectra(dataset: "xr.Dataset") -> go.Figure:
    names, per_period = _channels(dataset), _samples_per_period(dataset)
    signals = np.stack([dataset[n].values for n in names])
    lines = np.arange(1, min(per_period // 2, 2500))
    fundamental = dataset.attrs["sample_rate"] / per_period
    periods = split_periods(signals, per_period)
    kept = periods[1:] if len(periods) > 2 else periods
    statistics = line_statistics((period_spectra(p, lines) for p in kept), fundamental, lines, tuple(names))
    figure = make_subplots(rows=len(names), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, name in enumerate(names, 1):
        factor, unit = _unit(dataset, name)
        level = np.abs(statistics.amplitude(name)) * factor
        noise = np.sqrt(statistics.cross(name, name)) * factor
        for label, values, style in (
            ("mean", level, {"mode": "markers", "marker": {"size": 4, "color": COLOURS[0]}}),
            ("noise of the mean", noise, {"line": {"width": 1, "color": COLOURS[1]}}),
        ):
            drawn = _of_bands(statistics.frequency, values)
            at = {"x": statistics.frequency[drawn], "y": values[drawn], "row": row, "col": 1}
            figure.add_scatter(**at, name=label, showlegend=row == 1, **style)
        figure.update_yaxes(title_text=f"{name}, {unit}", type="log", exponentformat="power", row=row, col=1)
    figure.update_xaxes(type="log").update_xaxes(title_text="frequency, Hz", row=len(names), col=1)
    return styled(figure, 200 * len(names) + 80)


def _of_bands(frequency: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Lines to draw on a logarithmic axis: their indices; where they lie dense, only what bounds them."""
    return _extremes(level, np.floor(_PER_DECADE * np.log10(frequency)).astype(int))


def _extremes(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Indices of the smallest and the largest value of each group, in order.

    A drawing of them cannot be told from one of all values where a group is as narrow as the pen. Every n-th value
    instead would show slow waves that nobody recorded.

    Args:
        values: (n,).
        group: number of the group of each value, (n,), not falling.
    """
    order = np.lexsort((values, group))
    ends = np.flatnonzero(np.diff(group[order]))
    return np.unique(order[np.concatenate([[0], ends, ends + 1, [len(order) - 1]])])
