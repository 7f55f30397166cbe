"""An open record as it is under a controller with other gains than those that are stated."""

from dataclasses import replace

from maglev_env.loop.gains import Controllers
from sim2real.recorded.drive.drive import Drive
from sim2real.recorded.open_record import OpenRecord


def under_gains(record: OpenRecord, gains: Controllers) -> OpenRecord:
    """The record with these gains; a command that nobody recorded follows from the readings by them.

    Args:
        record: without a source: what drives it is recorded, and its controller is the stated one.
        gains: of the other controller.
    """
    other = replace(record.experiment, gains=gains)
    driving = {"injection": record.waves["current"], "reference": record.waves["reference"]}
    driven = Drive(other).driving({**record.series, **driving})
    return replace(record, experiment=other, command=driven.command, added=driven.added)
