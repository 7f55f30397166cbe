"""Figures of calibrations: output over displacement with its line, and the response to motion."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.calibrate.numbers import deviation, half_widths
from maglev_workbench.commands.selfsense.calibrate.sources import Dynamic, Static
from maglev_workbench.page import COLOURS, labelled_axis, shaded, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_CUT = 20.0  # dB that a band which reaches zero is drawn below the magnitude
_NOISY = 0.2  # half an interval, as a share of the response, from which on a line counts as noisy
_PANEL = 3.0  # times the linear range's own deviations that the lower panel shows


def line(s: Static) -> "Figure":
    """Output over displacement with the fitted line, and below it the deviations of the points from the line."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    x, y = s.axes
    low, high = (v * x.factor for v in s.found.linear_range)
    grid = {"shared_xaxes": True, "vertical_spacing": 0.06, "row_heights": [0.65, 0.35]}
    figure = styled(make_subplots(2, 1, **grid), 560)
    places, read, off = s.displacement * x.factor, s.output * y.factor, 100 * deviation(s)
    ends = np.array([s.displacement.min(), s.displacement.max()])
    drawn = {"x": ends * x.factor, "y": (s.found.gain * ends + s.found.offset) * y.factor, "mode": "lines"}
    figure.add_trace(Scatter(**drawn, name="line", line={"color": "#222", "dash": "dash"}), row=1, col=1)
    dots = {"mode": "markers", "marker": {"color": COLOURS[0], "size": 7}}
    text = f"%{{x:.5g}} {x.unit}: %{{y:.5g}} {y.unit}<extra></extra>"
    figure.add_trace(Scatter(x=places, y=read, **dots, name="reading", hovertemplate=text), row=1, col=1)
    text = f"%{{x:.5g}} {x.unit}: %{{y:.3g}} %<extra></extra>"
    figure.add_trace(Scatter(x=places, y=off, **dots, showlegend=False, hovertemplate=text), row=2, col=1)
    figure.add_vrect(low, high, fillcolor=COLOURS[2], opacity=0.12, line_width=0)
    span = np.ptp(read)
    figure.update_yaxes(
        title_text=_titled(y.name, y.unit), range=[read.min() - 0.08 * span, read.max() + 0.15 * span], row=1, col=1
    )
    reach = max(_PANEL * 100 * s.found.linearity_error, 1e-6)
    figure.update_yaxes(title_text="off the line in %<br>of full scale", range=[-reach, reach], row=2, col=1)
    figure.update_xaxes(title_text=_titled(x.name, x.unit), row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": 1.08})


def bode(d: Dynamic) -> "Figure":
    """Magnitude and phase of estimate over displacement with 95 % bands, the best pure delay and the linear model."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    c = d.found
    f, size, half = c.frequency, np.abs(c.response), half_widths(d)
    with np.errstate(divide="ignore"):
        low, high = (20 * np.log10(np.maximum(size + s * half, size * 10 ** (-_CUT / 20))) for s in (-1, 1))
    turn = np.degrees(np.arcsin(np.minimum(1.0, half / size)))
    delayed = -360 * f * c.delay
    rest = np.degrees(np.angle(c.polarity * c.response * np.exp(-1j * np.radians(delayed))))
    phase = delayed + rest
    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06), 600)
    dots = {"mode": "markers", "marker": {"color": COLOURS[0], "size": 3 if f.size > 300 else 5}}
    for row, values, bottom, top, unit in (
        (1, 20 * np.log10(size), low, high, "dB"),
        (2, phase, phase - turn, phase + turn, "°"),
    ):
        figure.add_trace(shaded(f, bottom, top, COLOURS[0]), row=row, col=1)
        text = f"%{{x:.5g}} Hz: %{{y:.4g}} {unit}<extra>calibration</extra>"
        trace = Scatter(x=f, y=values, **dots, name="calibration", hovertemplate=text, showlegend=row == 1)
        figure.add_trace(trace, row=row, col=1)
    dashed = {"color": COLOURS[1], "dash": "dash", "width": 1.5}
    figure.add_trace(Scatter(x=f, y=delayed, mode="lines", line=dashed, name="pure delay"), row=2, col=1)
    if d.model is not None:
        model = c.polarity * d.model
        curves = (20 * np.log10(np.abs(model)), np.degrees(np.unwrap(np.angle(model))))
        for row, values in enumerate(curves, 1):
            style = {"mode": "lines", "line": {"color": "#222", "width": 1.2}, "showlegend": row == 1}
            figure.add_trace(Scatter(x=f, y=values, **style, name="linear model"), row=row, col=1)
    figure.update_xaxes(**labelled_axis("", f, log=True)).update_xaxes(title_text="frequency in Hz", row=2, col=1)
    clear = half < _NOISY * size  # noisy lines must not set the scale
    clear = clear if clear.any() else np.ones(f.size, dtype=bool)
    for row, values, title, pad in ((1, 20 * np.log10(size), "magnitude in dB", 1.0), (2, phase, "phase in °", 5.0)):
        bottom, top = np.percentile(values[clear], [1, 99])
        reach = 0.3 * (top - bottom) + pad
        figure.update_yaxes(title_text=title, range=[bottom - reach, top + reach], row=row, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": 1.08})


def _titled(name: str, unit: str) -> str:
    return f"{name} in {unit}" if unit else name
