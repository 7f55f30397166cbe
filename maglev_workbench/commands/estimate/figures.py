"""Figures of an identification: coefficients against frequency, the receptance, and |S|."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from estimation.lines.frequency_response import frequency_response
from estimation.normal import NORMAL_95
from maglev_env.evaluation.bands import Band
from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.stability import Stability
from maglev_env.units import common_unit
from maglev_workbench.page import COLOURS, labelled_axis, mark_iso_zones, shaded, styled, with_interval

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_WILD = 1e3  # times its size by least squares, from which that of maximum likelihood is no estimate
COEFFICIENTS = {"stiffness": "N/m", "damping": "N s/m"}  # SI units
Units = Mapping[str, tuple[float, str]]  # of each coefficient: factor from SI, and the unit in which it is shown


def units_of(bands: Sequence[Band]) -> Units:
    """Units that fit the size of the coefficients in these bands."""
    sure = [b for b in bands if b.informative] or bands
    return {name: common_unit(_sizes(sure, name), si) for name, si in COEFFICIENTS.items()}


def _sizes(bands: Sequence[Band], name: str) -> list[float]:
    """A coefficient of bands, SI; by least squares, which noise cannot inflate, where maximum likelihood runs away."""
    likely, least = ([getattr(b, key) for b in bands] for key in (name, f"ls_{name}"))
    sizes = [float(np.median(np.abs(values))) for values in (likely, least)]
    return least if sizes[0] > _WILD * sizes[1] > 0 else likely


def estimate(band: Band, method: str, name: str) -> tuple[float, float, tuple[float, float]]:
    """Value, standard error and 95 % interval of a coefficient by one method, SI."""
    if method == "ml":
        return getattr(band, name), getattr(band, f"{name}_se"), getattr(band, f"{name}_ci")
    value, se = getattr(band, f"ls_{name}"), getattr(band, f"ls_{name}_se")
    return value, se, (value - NORMAL_95 * se, value + NORMAL_95 * se)


def in_words(band: Band, method: str, name: str, scale: float) -> str:
    value, _, (low, high) = estimate(band, method, name)
    return with_interval(value * scale, low * scale, high * scale)


def coefficients(bands: Sequence[Band]) -> "Figure":
    """Stiffness and damping over frequency: maximum likelihood with error bars, least squares, effective values."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    units = units_of(bands)
    titles = [f"{name} in {unit}" for name, (_, unit) in units.items()]
    figure = styled(make_subplots(1, 2, subplot_titles=titles), 460)
    centre = np.array([(band.f_lo + band.f_hi) / 2 for band in bands])
    good = np.array([band.informative for band in bands])
    biased = np.array([band.ls_biased for band in bands])
    for col, (name, (scale, unit)) in enumerate(units.items(), 1):
        ml, low, high = scale * np.array([(getattr(b, name), *getattr(b, f"{name}_ci")) for b in bands]).T
        ls = scale * np.array([getattr(b, f"ls_{name}") for b in bands])
        promised = [getattr(b, f"effective_{name}") for b in bands]
        core = np.concatenate([ml[good], ls[good & ~biased]]) if good.any() else ml
        bottom, top = np.nanmin(core), np.nanmax(core)
        expected = np.array([np.nan if value is None else scale * value for value in promised])
        # What lies further away would flatten all others.
        near = expected[np.abs(expected - (top + bottom) / 2) <= 1.5 * (top - bottom)]
        if near.size:
            bottom, top = min(bottom, near.min()), max(top, near.max())
        pad = 0.15 * (top - bottom) + 0.02 * abs(top) + 1e-12
        figure.update_yaxes(range=[bottom - pad, top + pad], row=1, col=col)
        reach = 2 * (top - bottom + 2 * pad)  # replaces infinity: extends beyond the panel
        low, high = np.clip(low, bottom - reach, ml), np.clip(high, ml, top + reach)
        symbols = ["x-thin-open" if b else "circle" for b in biased]
        marker = {"symbol": symbols, "size": [8 if b else 3 for b in biased]}
        extra = {"legendgroup": "LS", "showlegend": col == 1, "name": "least squares"}
        figure.add_trace(Scatter(x=centre, y=ls, line={"color": COLOURS[1], "width": 1.5}, marker=marker,
                                 mode="lines+markers", **extra), row=1, col=col)  # fmt: skip
        for some, opacity, symbol, label in ((good, 1, "circle", "ML"), (~good, 0.4, "circle-open", "ML, unbounded")):
            if some.any():
                ends = np.stack([low, high], axis=-1)[some]
                bars = {"array": ends[:, 1] - ml[some], "arrayminus": ml[some] - ends[:, 0], "thickness": 1, "width": 2}
                text = f"%{{x:g}} Hz: %{{y:.4g}} {unit}<br>%{{text}}<extra>{label}</extra>"
                hover = [in_words(b, "ml", name, scale) for b, wanted in zip(bands, some, strict=True) if wanted]
                trace = {"x": centre[some], "y": ml[some], "text": hover, "hovertemplate": text, "mode": "markers"}
                style = {"marker": {"color": COLOURS[0], "symbol": symbol, "size": 6}, "opacity": opacity}
                shown = {"name": label, "legendgroup": label, "showlegend": col == 1}
                figure.add_trace(Scatter(**trace, **style, **shown, error_y=bars), row=1, col=col)
        if np.isfinite(expected).any():
            extra = {"legendgroup": "eff", "showlegend": col == 1, "name": "promised by the gains"}
            line = {"color": COLOURS[2], "dash": "dash"}
            figure.add_trace(Scatter(x=centre, y=expected, mode="lines", line=line, **extra), row=1, col=col)
    figure.update_xaxes(title_text="centre of the band in Hz")
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})


def receptance(found: Identification) -> "Figure":
    """Bode diagram of displacement over force with two standard deviations."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    f = found.statistics.frequency
    g, variance = frequency_response(found.statistics, "displacement", "force")
    size, sigma = np.abs(g), np.sqrt(variance / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        # A band that reaches zero is cut 40 dB below the magnitude.
        low, high = (20 * np.log10(np.maximum(size + s * sigma, size / 100)) for s in (-2, 2))
        turn = np.degrees(np.arcsin(np.minimum(1.0, 2 * sigma / size)))
        turn = np.where(2 * sigma >= size, 360.0, turn)
        phase = (np.degrees(np.angle(g)) + 270) % 360 - 270  # -270 to 90, so that -180 of a mass does not jump
        decibels = 20 * np.log10(size)
    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06), 560)
    line = {"mode": "lines+markers", "line": {"color": COLOURS[0], "width": 1.2}, "marker": {"size": 3}}
    for row, (y, bottom, top, unit) in enumerate(
        ((decibels, low, high, "dB"), (phase, *np.clip([phase - turn, phase + turn], -270, 90), "°")), 1
    ):
        figure.add_trace(shaded(f, bottom, top, COLOURS[0]), row=row, col=1)
        text = f"%{{x:.4g}} Hz: %{{y:.4g}} {unit}<extra></extra>"
        figure.add_trace(Scatter(x=f, y=y, hovertemplate=text, showlegend=False, **line), row=row, col=1)
    figure.update_xaxes(**labelled_axis("", f, log=True)).update_xaxes(title_text="frequency in Hz", row=2, col=1)
    figure.update_yaxes(title_text="magnitude in dB re 1 m/N", row=1, col=1)
    return figure.update_yaxes(title_text="phase in °", dtick=45, row=2, col=1)


def sensitivity(found: Stability) -> "Figure":
    """|S| over frequency with 95 % bands and the limits of ISO 14839-3."""
    from plotly.graph_objects import Figure, Scatter

    size, half = np.abs(found.sensitivity), NORMAL_95 * np.sqrt(found.variance / 2)
    low = np.maximum(size - half, size / 100)
    figure = styled(Figure(shaded(found.frequency, low, size + half, COLOURS[0])), 420)
    text = "%{x:.4g} Hz: |S| %{y:.4g} ± %{customdata:.2g}<extra></extra>"
    line = {"mode": "lines+markers", "line": {"color": COLOURS[0], "width": 1.2}, "marker": {"size": 4}}
    figure.add_trace(Scatter(x=found.frequency, y=size, customdata=half, hovertemplate=text, showlegend=False, **line))
    mark_iso_zones(figure, log=True)
    ends = np.array([np.nanmin(size) / 1.3, max(6.0, 1.2 * np.nanmax(size))])
    figure.update_xaxes(**labelled_axis("frequency in Hz", found.frequency, log=True))
    return figure.update_yaxes(**labelled_axis("|S|", ends, log=True), range=np.log10(ends))
