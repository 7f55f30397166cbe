"""The self-sensor of the dissertation's simulations, and a figure of lines."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.design.defaults import with_defaults
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.commands.selfsense.rig_sensor import DEFAULT_RIG, DISSERTATION_RATE
from maglev_workbench.page import COLOURS, labelled_axis, styled
from selfsense.design import LAG, design_pi, with_gains
from selfsense.sensor import SelfSensor

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LAG_IN_D, LAG_AT = 18.0, 4000.0  # degrees, Hz: Fig. 6.14


def dissertation_sensor(path: str = "digital", rate: float = DISSERTATION_RATE) -> tuple[Rig, SelfSensor]:
    """Rig and self-sensor of eq 6.13 (no back-EMF) with 24 V at 25 kHz, read at rate (Hz) without noise and rounding.

    Chapter 6 names no coil: that of Table 3.4 stands in, with 0.571 mH at 0.35 mm. Nor does it give gains: with the
    digital path they are those for 35 degrees of lag at 4 kHz; the analog one does not reach that and has none.
    """
    rig = with_defaults(load_rig(DEFAULT_RIG))
    # These gains only keep the table from designing its own, which the analog path does not reach.
    sensing = replace(rig.self_sensing, sample_rate=rate, adc_bits=0, forward_path=path, kp=0.0, ki=1.0)
    rig = replace(rig, self_sensing=sensing, noise=replace(rig.noise, current=0.0))
    sensor = rig_sensors(rig)[0]
    coil = replace(sensor.estimator.coil, back_emf=False)
    sensor = replace(sensor, coil=coil, estimator=replace(sensor.estimator, coil=coil))
    return rig, designed_for(sensor, LAG) if path == "digital" else with_gains(sensor, 0.0, 0.0)


def designed_for(sensor: SelfSensor, lag: float) -> SelfSensor:
    """The sensor with the gains of the largest phase margin for a lag (degrees) at 4 kHz."""
    found = design_pi(sensor, lag, LAG_AT)
    return with_gains(sensor, found.kp, found.ki)


def lines_figure(x_title: str, y_title: str, traces: Sequence[tuple[str, Any, Any]], log: bool = False) -> "Figure":
    """Named lines (name, x, y); a name that begins with 'published' is drawn dotted and dark."""
    from plotly.graph_objects import Figure, Scatter

    figure = styled(Figure(), 420)
    colours = iter((*COLOURS, "#CC79A7", "#E69F00", "#56B4E9"))
    for name, x, y in traces:
        known = name.startswith("published")
        line = {"color": "#222", "dash": "dot"} if known else {"color": next(colours), "width": 1.5}
        figure.add_trace(Scatter(x=x, y=y, mode="lines+markers" if len(x) < 3 else "lines", line=line, name=name))
    every = np.concatenate([np.asarray(x, dtype=float) for _, x, _ in traces])
    figure.update_xaxes(**labelled_axis(x_title, every, log)).update_yaxes(title_text=y_title)
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})
