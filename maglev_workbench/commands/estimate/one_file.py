"""A single data file that is read without a campaign, for a first look."""

from dataclasses import dataclass
from pathlib import Path

from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.rig.excitation import Excitation, parse_lines
from maglev_workbench.columns import column_source


@dataclass(frozen=True)
class OneFile:
    """How to read a single file.

    Args:
        rate: sample rate, Hz; None where it was not given.
        fundamental: of the excitation, Hz.
        lines: excited harmonics, first:last[:step].
        recorded: the force is not periodic.
        force, displacement: columns, name[*scale].
        start: first sample used.
        samples: number of samples used; None: to the end.
        intersample: the force between samples, "bl" or "zoh"; None if it was not given.
    """

    rate: float | None
    fundamental: float
    lines: str
    recorded: bool
    force: str
    displacement: str
    start: int
    samples: int | None
    intersample: str | None


def one_file_campaign(path: Path, mass: float | None, one: OneFile) -> Campaign:
    """A campaign of this one recording, without a rig.

    Args:
        path: the file.
        mass: moving mass, kg; None if it is not known.
        one: how to read it, as stated.

    Raises:
        ValueError: The sample rate is missing.
    """
    if one.rate is None or not one.rate > 0:
        raise ValueError(f"{path}: one file needs its sample rate: --rate HZ")
    if one.recorded:
        excitation = Excitation("recorded", "force")
    else:
        excitation = Excitation("sphs", "force", one.fundamental, parse_lines(one.lines))
    channels = {"force": column_source(one.force), "displacement": column_source(one.displacement)}
    spec = RecordingSpec(
        path.name,
        "fit",
        one.rate,
        one.start,
        one.samples,
        None,
        0.0,
        None,
        (excitation,),
        channels,
        one.intersample,
    )
    return Campaign(path.parent, None, mass, (spec,))
