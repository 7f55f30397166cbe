"""A figure of what each recording says of a rig alone, beside all of them together and the nominal rig."""

from typing import TYPE_CHECKING

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.units import prefixed
from maglev_workbench.page import COLOURS, styled
from sim2real.coefficients import Coefficient
from sim2real.pooled import Pooled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ALL = "all together"
_ROW, _EDGES = 26, 130  # px


def shown_unit(c: Coefficient) -> tuple[float, str]:
    """Factor and name of the unit in which a coefficient is shown."""
    return prefixed(c.nominal or max(c.interval, key=abs), c.unit)


def each_figure(found: Pooled) -> "Figure | None":
    """Each coefficient's intervals (95 %), a row for each recording; None where fewer than two rows tell any."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    rows = {**found.of_each, ALL: found.coefficients}
    told = {name: {c.name: c for c in own if c.identified} for name, own in rows.items()}
    names = [name for name, own in told.items() if own]
    shown = [c for c in found.coefficients if sum(c.name in own for own in told.values()) > 1]
    if len(names) < 2 or not shown:
        return None
    figure = make_subplots(1, len(shown), shared_yaxes=True, horizontal_spacing=0.03)
    figure = styled(figure, _EDGES + _ROW * len(names))
    for column, c in enumerate(shown, start=1):
        scale, unit = shown_unit(c)
        own = [(name, told[name][c.name]) for name in names if c.name in told[name]]
        trace = Scatter(
            x=scale * np.array([one.value for _, one in own]), y=[name for name, _ in own], mode="markers",
            error_x={"array": NORMAL_95 * scale * np.array([one.se for _, one in own]), "thickness": 1.5, "width": 4},
            marker={"color": [COLOURS[name == ALL] for name, _ in own], "size": 8}, showlegend=False,
            hovertemplate="%{y}: %{x:.4g}<extra></extra>",
        )  # fmt: skip
        figure.add_trace(trace, row=1, col=column)
        figure.add_vline(c.nominal * scale, line={"dash": "dot", "color": "#888", "width": 1}, row=1, col=column)
        figure.update_xaxes(title_text=f"{c.name.replace('_', ' ')}, {unit}", nticks=5, row=1, col=column)
    return figure.update_yaxes(categoryorder="array", categoryarray=names[::-1], type="category", automargin=True)
