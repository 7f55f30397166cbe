"""An open record as it is under a controller with other gains than those that are stated."""

from dataclasses import replace

from maglev_env.loop.gains import Controllers, controller_output, of_axis
from sim2real.recorded.drive.controller_output import referred
from sim2real.recorded.open_record import OpenRecord


def under_gains(record: OpenRecord, gains: Controllers) -> OpenRecord:
    """The record with these gains; a command that nobody recorded follows from the readings by them.

    Args:
        record: without a source: what drives it is recorded, and its controller is the stated one.
        gains: of the other controller.
    """
    e, dt = record.experiment, 1 / record.experiment.rig.control_rate
    command, added = record.command.copy(), record.added.copy()
    for axis, reference in enumerate(record.waves["reference"]):
        read = {name: series[axis] for name, series in record.series.items()}
        for sign, own in ((-1.0, e.gains), (1.0, gains)):
            controller = of_axis(own, axis)
            command[axis] += sign * controller_output(controller, dt=dt, reference=reference, **read)
            added[axis] += sign * referred(controller, reference, dt)
    return replace(record, experiment=replace(e, gains=gains), command=command, added=added)
