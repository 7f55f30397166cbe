"""What one recording says of a point: its opened coordinates, their noise, and what is not known of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim2real.compared.crossed import crossed_columns
from sim2real.compared.drive_errors import drive_columns
from sim2real.compared.law_shape import (
    BEND,
    FORM_NAME,
    STEEPNESS_NAME,
    law_shapes,
    rest_current,
    shape_columns,
    shape_directions,
    shows_shape,
    with_bent_law,
)
from sim2real.compared.open_tones import nuisance_columns
from sim2real.compared.point import Point, is_dithered
from sim2real.compared.simulated import Predictor, experiment_near, lanes_of, predictor, series_at
from sim2real.recorded.channel_errors import changes
from sim2real.recorded.drive.anchored import anchored
from sim2real.recorded.drive.quiet import quiet
from sim2real.recorded.noise_response import NoiseResponse
from sim2real.recorded.open_evidence import (
    Replay,
    coordinates_of,
    exact_errors,
    measured_of,
    measured_series,
    open_noise,
    opened_of,
    parts_of,
    redriven,
    simulated_series,
    smoothed_alike,
)
from sim2real.recorded.open_loop import Loop, loop_at
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened, noise_of, opened_loop
from sim2real.recorded.records import Record
from sim2real.recorded.ringing import ringing
from sim2real.recorded.slow_drift import drift_columns
from sim2real.recorded.static_load import loads_off

# Power that a simulation leaves of what is compared, over that of the noise, up to which a stand-in may follow it.
NEAR = 3.0


@dataclass(frozen=True)
class Evidence:
    """The opened nominal loop of a record, and what predicts, was measured, is noise and is not known in it."""

    opened: Opened
    predictor: Predictor
    measured: np.ndarray
    noise: np.ndarray
    nuisances: Mapping[str, np.ndarray]


def evidence_of(
    record: Record | OpenRecord, near: Point, amounts: Mapping[str, float], for_estimate: bool = False
) -> Evidence:
    """What a record says, compared with a point; the errors of a measured drive are linearised about their amounts, and
    what two axes may do to each other is a nuisance `for_estimate`.

    The errors act in proportion on the drive, but their product with a coefficient does not: a current that is late by
    half a sample hides what the gain does unless the simulation has it, too.
    """
    if not isinstance(record, OpenRecord):
        opened = opened_loop(record)
        current = record.mean("current") if "current" in record.periods else None
        measured = opened.residuals(record.mean("displacement"), current)
        nuisances = changes(record.errors, record.frequency, opened.outputs, opened.parts(record))
        predicts = predictor(record, opened)
        if record.load is not None and np.isfinite(held := predicts([near])[0]).all():
            moved = {name: predictor(own, opened)([near])[0] for name, own in loads_off(record).items()}
            nuisances |= shape_columns(held, moved)
        return Evidence(opened, predicts, measured, noise_of(record, opened), nuisances)
    unbent, bends = record.nominal, {name: -amounts[name] for name in (FORM_NAME, STEEPNESS_NAME) if name in amounts}
    # Where the mass rests, a law that bends would take up what motion says against means and weight.
    if bends and shows_shape(record) and record.axes == 1 and record.rests is None:
        record = with_bent_law(record, bends)
    measured_drive = exact_errors(record)
    about = {e: amounts[e.name] for e in measured_drive if e.name in amounts}
    as_read, record = record, redriven(record, about)
    at_near = experiment_near(record, near)
    lanes = lanes_of(record, [near])
    predicted = series_at(record, near, lanes)
    loop = loop_at(record, at_near, predicted)
    opened = opened_of(loop)
    predicts = Predictor(record, opened, 0, Replay(record, loop, opened.outputs), near=near)
    measured = measured_at(record, loop, opened.outputs)
    noise = open_noise(record, loop, opened.outputs, predicted, at_near)
    nuisances = ringing(record, loop, opened.outputs, noise, at_near) | drift_columns(record, loop, opened.outputs)
    if np.isfinite(predicted).all():
        at = coordinates_of(record, loop, opened.outputs, predicted)
        left = measured - at
        if about and float(np.mean(abs(left / noise)[..., record.excited] ** 2)) < NEAR:
            series = measured_series(record) - predicted
            series[0] = quiet(record.series["displacement"]) - predicted[0]
            moved = loop.opened(record, series[0], series[2], None)[0]
            by_rig = anchored(record, moved)
            series = series_at(by_rig, near, lanes)
            if np.isfinite(series).all():
                record, as_read, predicted = by_rig, anchored(as_read, moved), series
                predicts = Predictor(record, opened, 0, Replay(record, loop, opened.outputs), near=near)
                at = coordinates_of(record, loop, opened.outputs, predicted)
                measured = left + at
        # What a small change does is simulated without the noise that may smooth it: with and without that change.
        held = at
        if is_dithered(near, record.nominal):
            held = coordinates_of(record, loop, opened.outputs, simulated_series(record, lanes)[0])
        response = None
        if record.instrument is not None and record.told is not None:
            response = NoiseResponse(at, measured - at, noise, record.told)
        if record.errors:
            others = tuple(e for e in record.errors if e not in measured_drive)
            lines = changes(others, record.windows.frequency, opened.outputs, parts_of(record, loop, predicted))
            nuisances |= {name: record.windows.project(c).reshape(measured.shape) for name, c in lines.items()}
            driven = drive_columns(as_read, predicts, lanes, near, about, held)
            if response is not None:
                driven |= response.without_in({e.name: driven[e.name] for e in measured_drive if e.scale})
            nuisances |= driven
            nuisances |= smoothed_alike(record, loop, opened.outputs, lanes, held)
            for error in measured_drive:
                measured = measured - about.get(error, 0.0) * nuisances[error.name]
        if response is not None:
            predicts = Predictor(record, opened, 0, Replay(record, loop, opened.outputs, response), near=near)
        if shows_shape(record):
            bending, step = record.nominal is not unbent, 1.0
            if bending:
                step, shapes = BEND, law_shapes(record.nominal, near, shape_directions(unbent), BEND)
            else:
                shapes = law_shapes(record.nominal, near)
            resting = rest_current(record, near)
            moved = predicts([*shapes.values(), *resting.values()])
            columns = shape_columns(held, dict(zip([*shapes, *resting], moved, strict=True)))
            nuisances |= {name: c / (step if name in shapes else 1.0) for name, c in columns.items()}
            if bending:
                measured = measured + sum(bends[name] * nuisances[name] for name in bends)
        for name, own in loads_off(record).items():
            loaded = coordinates_of(record, loop, opened.outputs, simulated_series(own, lanes)[0])
            nuisances |= shape_columns(held, {name: loaded})
        if for_estimate:
            nuisances |= crossed_columns(record, loop, opened.outputs, predicted, at_near)
    for tone in record.tones:
        nuisances |= nuisance_columns(record, tone, opened.outputs)
    for source, size in record.unsure.items():
        fed = np.zeros_like(measured)
        fed[opened.outputs.index("plant")] = size
        nuisances[source] = fed
    return Evidence(opened, predicts, measured, noise, nuisances)


def measured_at(record: OpenRecord, loop: Loop, outputs: tuple[str, ...]) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of a record, without what noise in its drive added."""
    measured = measured_of(record, loop, outputs)
    if record.bias is not None:
        measured[outputs.index("plant")] -= record.bias
    return measured
