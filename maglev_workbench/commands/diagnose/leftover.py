"""What the best partial explanation of an unexplained gap leaves: a section of the page, with its figure."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.units import prefixed
from maglev_workbench.page import COLOURS, html_text, labelled_axis, note, shaded, styled, table
from sim2real.gap.leftover import Leftover
from sim2real.gap.leftover_words import LEAST, leftover_lines
from sim2real.gap.missing_force import QUANTITIES, Profile
from sim2real.words import percent, quantity

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_NOTE = (
    "First: rms of the residual in units of its noise; 1 (dotted) is noise alone. Others: the force that would have to "
    "act on the rotor for the simulation to be right, its mean over each quantity as simulated; shaded: two standard "
    "errors; %: the share of its power that this curve describes. A slope over the displacement is a stiffness, a bend "
    "another force law; over the current an actuator's law; over the velocity damping, or a step at zero friction."
)
_HEAD = ("recording", "rms of the motion", "chi-square per degree of freedom", "share of what is left", "when")


def leftover_sections(left: Leftover) -> "list[tuple[str, str | Figure]]":
    """Sections of a page: sentences, the residual's figure, and the recordings with their times."""
    rows = [
        (
            r.name,
            quantity(r.motion, None, "m"),
            f"{r.chi_square:.3g}",
            percent(r.share),
            ", ".join(f"{a:.3g} .. {b:.3g} s: {percent(s)}" for a, b, s in r.segments if s >= LEAST and r.share) or "–",
        )
        for r in left.recordings
    ]
    lines = "".join(f"<li>{html_text(line.replace(' +- ', ' ± '))}</li>" for line in leftover_lines(left))
    return [
        ("What the best partial explanation leaves", f"<ul>{lines}</ul>"),
        ("", residual_figure(left)),
        ("", note(_NOTE)),
        ("", table(_HEAD, rows).replace("<td>", '<td class="wrapped">')),
    ]


def residual_figure(left: Leftover) -> "Figure":
    """The residual over frequency, and the missing force over displacement, current and velocity."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    rows = 1 + len(left.profiles) // 2
    titles = ["residual / noise", *(f"missing force over the {p.quantity}: {percent(p.share)}" for p in left.profiles)]
    figure = styled(make_subplots(rows, 2, subplot_titles=titles, vertical_spacing=0.2), 120 + 270 * rows)
    curves = (("calibrated", left.before, COLOURS[1]), ("best partial", left.after, COLOURS[0]))
    seen = [1.0]
    for name, values, colour in curves:
        if np.isfinite(values).any():
            text = f"%{{x:.4g}} Hz: %{{y:.3g}} times the noise<extra>{name}</extra>"
            seen += list(values[np.isfinite(values) & (values > 0)])
            figure.add_trace(Scatter(x=left.frequency, y=values, name=name, line={"color": colour}, hovertemplate=text,
                                     mode="lines+markers", marker={"size": 4}), row=1, col=1)  # fmt: skip
    figure.add_hline(1.0, row=1, col=1, line={"color": "#666", "width": 1, "dash": "dot"})
    figure.update_xaxes(**labelled_axis("frequency in Hz", left.frequency, log=True), row=1, col=1)
    ends = np.array([min(seen) / 1.3, max(seen) * 1.3])
    figure.update_yaxes(**labelled_axis("", ends, log=True), range=np.log10(ends), row=1, col=1)
    reach = max((float(abs(p.force).max()) for p in left.profiles), default=0.0)
    scale, unit = prefixed(reach, "N")
    for place, profile in enumerate(left.profiles, 1):
        _profile(figure, profile, scale, unit, {"row": place // 2 + 1, "col": place % 2 + 1})
    return figure.update_layout(legend={"orientation": "h", "y": -0.12})


def _profile(figure: "Figure", p: Profile, scale: float, unit: str, at: dict[str, int]) -> None:
    from plotly.graph_objects import Scatter

    across, across_unit = prefixed(float(abs(p.at).max()), QUANTITIES[p.quantity])
    x, y, se = p.at * across, p.force * scale, p.se * scale
    figure.add_trace(shaded(x, y - 2 * se, y + 2 * se, COLOURS[0]), **at)
    text = f"%{{x:.3g}} {across_unit}: %{{y:.3g}} {unit}<extra></extra>"
    figure.add_trace(Scatter(x=x, y=y, line={"color": COLOURS[0]}, showlegend=False, hovertemplate=text), **at)
    figure.update_xaxes(title_text=f"{p.quantity} in {across_unit}", **at)
    figure.update_yaxes(title_text=f"force in {unit}", **at)
