"""A campaign: a folder of recordings described by campaign.toml, with the nominal rig they were made on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal

from maglev_env.fields import check_known
from maglev_env.loop.gains import Controllers
from maglev_env.recordings.campaign_file import campaign_tables, check_schema
from maglev_env.recordings.campaign_tables import (
    ChannelSource,
    channel_table,
    excitations_table,
    number_of,
    table_of,
    whole_of,
)
from maglev_env.recordings.files import OpenedFiles
from maglev_env.recordings.formats.text_layout import TextLayout, layout_table
from maglev_env.recordings.left_out import LeftOut
from maglev_env.rig.controller_tables import controllers_from_table
from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.rig.rig_file import PRESETS, load_rig

__all__ = ["Campaign", "ChannelSource", "RecordingSpec", "load_campaign"]

ROLES = ("fit", "holdout")
INTERSAMPLE = ("bl", "zoh")
_RECORDING_KEYS = (
    *("file", "role", "sample_rate", "start", "samples", "speed_rpm", "intersample"),
    *("gains", "controller", "excitation", "channels", "format"),
)


@dataclass(frozen=True)
class RecordingSpec:
    """One recording of a campaign as campaign.toml states it.

    Attributes:
        file: Relative to the campaign's folder.
        role: "fit" or "holdout".
        sample_rate: Hz.
        start: First sample used, counted from 0.
        samples: Number of samples used; None for all to the end.
        periods: Number of whole periods in them, where stated.
        speed_rpm: Speed of rotation.
        gains: The controller, one for all axes or one each for x and y; None for an uncontrolled
            rotor.
        excitations: What excites the rig.
        channels: Where each channel comes from.
        intersample: Force between samples: band-limited ("bl", a reading) or held by a converter ("zoh"); None where
            it is not stated, see `signals.recorded_signals`.
        layout: What is stated of how a text file is written; None: nothing.
        stated_peaks: Places of the excitations whose amplitude is stated.
        name: What findings and results call it: its file, and where several are taken of one file, what tells them
            apart. No two recordings of a campaign have the same.
    """

    file: str
    role: str
    sample_rate: float
    start: int
    samples: int | None
    periods: int | None
    speed_rpm: float
    gains: Controllers | None
    excitations: tuple[Excitation, ...]
    channels: Mapping[str, ChannelSource]
    intersample: Literal["bl", "zoh"] | None = None
    layout: TextLayout | None = None
    stated_peaks: frozenset[str] = frozenset()
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.file)

    @property
    def samples_per_period(self) -> int | None:
        """Samples after which the excitation repeats on the sample grid; None when nothing periodic excites it.

        Where the fundamental does not divide the rate, that is the smallest block of several periods.
        """
        periodic = [e for e in self.excitations if e.periodic]
        return periodic[0].block(self.sample_rate)[0] if periodic else None


@dataclass(frozen=True)
class Campaign:
    """A folder of recordings.

    Attributes:
        folder: Where they lie.
        rig: Nominal rig; None: not known.
        mass: Moving mass, kg; None: to be estimated.
        recordings: Those that are used.
        files: Those that were read already.
        left_out: Those that were found to tell nothing when they were read.
    """

    folder: Path
    rig: Rig | None
    mass: float | None
    recordings: tuple[RecordingSpec, ...]
    files: OpenedFiles = field(default_factory=OpenedFiles, compare=False, repr=False)
    left_out: tuple[LeftOut, ...] = ()


def with_mass(campaign: Campaign, mass: float) -> Campaign:
    """The campaign with another moving mass, kg; masses of single axes keep their ratio to it."""
    rig = campaign.rig
    if rig is not None and mass != rig.mass:
        rig = scaled_rig(rig, {"mass": mass / rig.mass})
    return replace(campaign, mass=mass, rig=rig)


def load_campaign(folder_or_toml: str | Path) -> Campaign:
    """Read and check campaign.toml (schema maglev-campaign/1); data files must exist, but are not read.

    [parameters] override values of the rig; without a rig they may give the mass. `periods` of an excitation states the
    number of whole periods used from `start` on, transients included; without it and without `samples`, everything to
    the end is used. A random-phase multisine needs its channel, because its phases are unknown. An SPHS may lack its
    channel; its phases are then those of the design, and a period must begin exactly at `start` with the design's sign.

    Args:
        folder_or_toml: The campaign's folder, or its campaign.toml.

    Raises:
        ValueError: A value does not fit; the message names the file, the recording and the key.
        OSError: campaign.toml or a data file does not exist.
    """
    path, tables = campaign_tables(folder_or_toml)
    try:
        return parse_campaign(path.parent, tables)
    except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from error


def parse_campaign(folder: Path, data: Mapping[str, Any]) -> Campaign:
    """A campaign from the content of a campaign.toml.

    Args:
        folder: The campaign's folder.
        data: The file's tables.

    Raises:
        OSError: A data file does not exist.
        ValueError: The content does not fit; the recording and the key are named.
    """
    check_schema(data)
    check_known(data, ("schema", "rig", "parameters", "recording"), "top level")
    rig, mass = campaign_rig(folder, data.get("rig"), table_of(data.get("parameters", {}), "[parameters]"))
    tables = data.get("recording", [])
    if not isinstance(tables, list) or not tables:
        raise ValueError("there is no [[recording]]; give at least one")
    specs = [_recording(folder, table, number) for number, table in enumerate(tables, 1)]
    return Campaign(folder, rig, mass, _named_apart(specs))


def campaign_rig(folder: Path, source: Any, parameters: dict[str, Any]) -> tuple[Rig | None, float | None]:
    """The nominal rig that a campaign.toml names, with its [parameters], and the moving mass in kg.

    Either is None where it is not stated.

    Raises:
        ValueError: They do not fit.
    """
    if source is None:
        check_known(parameters, ("mass",), "[parameters] without a rig")
        if "mass" not in parameters:
            return None, None
        mass = number_of(parameters, "mass", None, "[parameters] without a rig")
        if mass <= 0:
            raise ValueError(f"[parameters]: mass = {mass} kg must be positive")
        return None, mass
    if not isinstance(source, str) or PurePosixPath(source).is_absolute() or PureWindowsPath(source).anchor:
        raise ValueError(f"rig = {source!r}; give a preset ({', '.join(PRESETS)}) or a path relative to campaign.toml")
    rig = load_rig(source if source in PRESETS or not source.endswith(".toml") else folder / source)
    rig = with_parameters(rig, parameters)
    return rig, rig.mass


def _named_apart(specs: Sequence[RecordingSpec]) -> tuple[RecordingSpec, ...]:
    """The recordings of a campaign, in order, those that share a file with names of their own."""
    files, starts = [spec.file for spec in specs], [(spec.file, spec.start) for spec in specs]
    found = []
    for number, spec in enumerate(specs, 1):
        name = spec.file
        if files.count(spec.file) > 1:
            name += f" from sample {spec.start}"
        if starts.count((spec.file, spec.start)) > 1:  # of other columns, or of another length
            name += f" (recording {number})"
        found.append(replace(spec, name=name))
    return tuple(found)


def _recording(folder: Path, table: Any, number: int) -> RecordingSpec:
    where = f"recording {number}"
    table = table_of(table, where)
    try:
        file = _data_file(folder, table.get("file"))
        where = f"{where} ({file})"
        check_known(table, _RECORDING_KEYS, "[[recording]]")
        return _checked_recording(file, table)
    except (ValueError, TypeError, ArithmeticError) as error:
        raise ValueError(f"{where}: {error}") from error


def _checked_recording(file: str, table: dict[str, Any]) -> RecordingSpec:
    role = table.get("role", "fit")
    if role not in ROLES:
        raise ValueError(f"role = {role!r}; use one of {', '.join(ROLES)}")
    intersample = table.get("intersample")
    if intersample is not None and intersample not in INTERSAMPLE:
        raise ValueError(f"intersample = {intersample!r}; use one of {', '.join(INTERSAMPLE)}")
    rate = number_of(table, "sample_rate")
    if rate <= 0:
        raise ValueError(f"sample_rate = {rate} Hz must be positive")
    if "gains" in table and "controller" in table:
        raise ValueError("give gains or a controller, not both")
    channels = {name: channel_table(name, t) for name, t in table_of(table.get("channels", {}), "channels").items()}
    if not set(channels) - {"time"}:
        raise ValueError("[recording.channels] names no channel; give at least displacement")
    excitations, periods = excitations_table(table.get("excitation"), rate, channels)
    samples = whole_of(table, "samples", None, 1)
    if periods is not None:
        block, of = next(e for e in excitations if e.periodic).block(rate)
        if periods % of:
            raise ValueError(
                f"periods = {periods}: only {of} periods together are whole samples ({block}); give a multiple of {of}"
            )
        wanted = periods // of * block
        if samples not in (None, wanted):
            raise ValueError(
                f"samples = {samples} are not {periods} periods of {block / of:g} samples, {wanted}; "
                "give samples or the excitation's periods"
            )
        samples = wanted
    return RecordingSpec(
        file=file,
        role=role,
        sample_rate=rate,
        start=whole_of(table, "start", 0, 0) or 0,
        samples=samples,
        periods=periods,
        speed_rpm=number_of(table, "speed_rpm", 0.0),
        gains=next((controllers_from_table(table[key], key) for key in ("gains", "controller") if key in table), None),
        excitations=excitations,
        channels=channels,
        intersample=intersample,
        layout=layout_table(table["format"]) if "format" in table else None,
        stated_peaks=frozenset(t.get("at", "force") for t in _tables(table["excitation"]) if "amplitude" in t),
    )


def _tables(value: Any) -> list[Mapping[str, Any]]:
    return value if isinstance(value, list) else [value]


def _data_file(folder: Path, file: Any) -> str:
    if not isinstance(file, str) or not file:
        raise ValueError(f"file = {file!r}; give the name of a data file beside campaign.toml")
    pure = PureWindowsPath(file)  # recognises separators and drives of both kinds of systems
    inside = not pure.anchor and ".." not in pure.parts
    if not inside or not (folder / file).resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"file = {file!r} leaves the campaign folder; put the file inside and name it relative to it")
    if not (folder / file).is_file():
        raise FileNotFoundError(f"{folder / file}: the campaign names this file, but it is not there")
    return file
