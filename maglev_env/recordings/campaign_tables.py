"""The tables of campaign.toml below a recording, checked: channels, excitations, gains and controller."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from maglev_env.channels import EFFORTS, RECORDED, SHOWN_BY
from maglev_env.fields import check_known, is_number
from maglev_env.rig.excitation import MAX_HARMONIC, Excitation, check_interleaved
from maglev_env.rig.tables import excitation_from_table

_AXES = ("", "_x", "_y", "_z")
CAMPAIGN_CHANNELS = ("time", *(name + axis for name in RECORDED for axis in _AXES))

_EXCITATION_KEYS = (*(f.name for f in fields(Excitation)), "harmonics", "periods", "period_samples")


_TOLERANCES = ("scale_tolerance", "offset_tolerance", "offset_drift", "delay_tolerance")
_CORNERS = ("filter", "high_pass")
_CHAIN = ("scale", "offset", "polynomial", *_CORNERS, "delay", "total", *_TOLERANCES)


@dataclass(frozen=True)
class ChannelSource:
    """Source of a channel: SI value = scale * (sum of weights * columns) + offset, and what lies before the logging.

    Attributes:
        polynomial: Coefficients, the constant first, of what is scaled in place of that sum: the calibration of a
            sensor that is not linear. None: it is.
        filter: Corner frequencies of first-order low-passes outside the control loop, Hz; they are undone.
        high_pass: Corner frequencies of first-order high-passes, by which it is AC coupled, Hz; they are undone.
        delay: By which the channel was read late, s; it is undone.
        total: Whether a current is the total one; else it is the deviation from the rig's bias.
        scale_tolerance: Relative standard uncertainty of the scale.
        offset_tolerance: Standard uncertainty of the offset, SI; None: the mean of the channel is not known at all.
        delay_tolerance: Standard uncertainty of the delay, s; None: not stated.
        offset_drift: Standard deviation of the offset from recording to recording, SI; None: not stated.
    """

    columns: tuple[str, ...]
    weights: tuple[float, ...]
    scale: float = 1.0
    offset: float = 0.0
    filter: tuple[float, ...] = ()
    delay: float = 0.0
    total: bool = False
    scale_tolerance: float = 0.0
    offset_tolerance: float | None = None
    delay_tolerance: float | None = None
    offset_drift: float | None = None
    high_pass: tuple[float, ...] = ()
    polynomial: tuple[float, ...] | None = None

    @property
    def expression(self) -> str:
        """Its columns as they are added, with the weights that are not 1: "a", "0.5 a - 0.5 b"."""
        text = ""
        for weight, column in zip(self.weights, self.columns, strict=True):
            sign = ("-" if weight < 0 else "") if not text else (" - " if weight < 0 else " + ")
            text += sign + (column if abs(weight) == 1 else f"{abs(weight):.4g} {column}")
        return text

    @property
    def chained(self) -> bool:
        """Whether anything is undone: then its samples are not those that were taken."""
        return bool(self.filter or self.high_pass or self.delay)


def excitations_table(value: Any, rate: float, channels: Mapping) -> tuple[tuple[Excitation, ...], int | None]:
    """The checked excitations of a recording sampled at `rate` (Hz), and their common number of periods, if stated."""
    if not value:
        raise ValueError('excitation is missing; write excitation = { kind = "none" } when nothing was excited')
    tables = [table_of(t, "excitation") for t in (value if isinstance(value, list) else [value])]
    found, periods = [], set()
    for table in tables:
        check_known(table, _EXCITATION_KEYS, "excitation")
        table = _in_hertz(table, rate)
        _check_lines(table, rate)
        excitation = excitation_from_table(table, ignored=("periods",))
        stated = whole_of(table, "periods", None, 2)
        if excitation.periodic:
            excitation.block(rate)
            periods.add(stated)
        elif stated is not None:
            raise ValueError(f"excitation: periods has no meaning with kind = {excitation.kind!r}")
        channel = SHOWN_BY[excitation.at]
        unknown = excitation.kind in ("multisine", "low_crest", "impulse", "recorded")
        if unknown and not any(channel + axis in channels for axis in _AXES):
            why = "its phases are unknown" if excitation.periodic else "its waveform is that channel"
            raise ValueError(f"excitation: {excitation.kind} at {excitation.at} needs the channel {channel}: {why}")
        if excitation.components[1] and not any(name.endswith(("_x", "_y")) for name in channels):
            raise ValueError("excitation: direction needs the channels of two axes, force_x, force_y, ...")
        found.append(excitation)
    check_interleaved(tuple(found))
    if len(periods - {None}) > 1:
        raise ValueError(f"excitation: periods {sorted(periods - {None})} differ; one recording has one number of them")
    return tuple(found), next(iter(periods - {None}), None)


def _in_hertz(table: Mapping[str, Any], rate: float) -> dict[str, Any]:
    """The table with its fundamental in Hz, which may be stated by the samples of a period instead."""
    samples = whole_of(table, "period_samples", None, 2)
    if samples is None:
        return dict(table)
    if "fundamental" in table:
        raise ValueError("excitation: give the fundamental or period_samples, not both")
    return {name: value for name, value in table.items() if name != "period_samples"} | {"fundamental": rate / samples}


def _check_lines(table: Mapping[str, Any], rate: float) -> None:
    fundamental = number_of(table, "fundamental", 1.0, "excitation")
    for key in ("lines", "harmonics"):
        for line in _list_of(table.get(key, []), f"excitation: {key}"):
            # Checked before a range is expanded, because a typing error must not allocate gigabytes.
            if type(line) is not int or not 1 <= line <= MAX_HARMONIC or line * fundamental >= rate / 2:
                raise ValueError(
                    f"excitation: {key}: {line!r} is not a whole number from 1 to below half the rate, "
                    f"{rate / 2:g} Hz at a fundamental of {fundamental:g} Hz"
                )


def channel_table(name: str, value: Any) -> ChannelSource:
    """The checked source of one channel of [recording.channels]."""
    check_known({name: value}, CAMPAIGN_CHANNELS, "[recording.channels]")
    where = f"channel {name}"
    table = table_of(value, where)
    check_known(table, ("from", "weights", *_CHAIN), where)
    columns = table.get("from")
    columns = [columns] if isinstance(columns, str) else columns
    if not isinstance(columns, list) or not columns or not all(isinstance(c, str) for c in columns):
        raise ValueError(f'{where}: from = {table.get("from")!r}; give a column, from = "F", or a list of columns')
    if len(columns) > 1 and "weights" not in table:
        raise ValueError(f"{where}: weights are missing; a mean of two columns is weights = [0.5, 0.5]")
    weights = _numbers(table.get("weights", [1.0]), f"{where}: weights")
    if len(weights) != len(columns):
        raise ValueError(f"{where}: {len(weights)} weights for {len(columns)} columns; give one weight per column")
    scale, offset = number_of(table, "scale", 1.0, where), number_of(table, "offset", 0.0, where)
    if scale == 0:
        raise ValueError(f"{where}: scale = 0 leaves nothing of the channel")
    bent = _numbers(table["polynomial"], f"{where}: polynomial") if "polynomial" in table else None
    if bent is not None and (len(bent) < 2 or not any(bent[1:])):
        raise ValueError(f"{where}: polynomial = {list(bent)} is constant; give its coefficients, the constant first")
    corners = {key: _numbers(table[key], f"{where}: {key}") for key in _CORNERS if key in table}
    for key, own in corners.items():
        if any(corner <= 0 for corner in own):
            raise ValueError(f"{where}: {key} = {list(own)}; give corner frequencies in Hz, above 0")
    delay = number_of(table, "delay", 0.0, where)
    total = table.get("total", False)
    if type(total) is not bool or (total and name.partition("_")[0] not in EFFORTS):
        raise ValueError(
            f"{where}: total = {total!r}; write total = true where a current, command or voltage includes the bias"
        )
    sigma = {key: number_of(table, key, None, where) for key in _TOLERANCES if key in table}
    for key, value in sigma.items():
        if value < 0:
            raise ValueError(f"{where}: {key} = {value:g} must not be negative; it is a standard uncertainty")
    if "high_pass" in corners and (total or "offset_tolerance" in sigma):
        said = "total = true" if total else "offset_tolerance"
        raise ValueError(f"{where}: {said} speaks of its mean, which high_pass has taken away: leave out one of both")
    return ChannelSource(tuple(columns), weights, scale, offset, delay=delay, total=total, polynomial=bent,
                         **corners, **sigma)  # fmt: skip


def table_of(value: Any, where: str) -> dict[str, Any]:
    """The value, which must be a table."""
    if not isinstance(value, dict):
        raise ValueError(f"{where} = {value!r} must be a table")
    return value


def number_of(table: Mapping[str, Any], key: str, default: float | None = None, where: str = "") -> float:
    """A finite number from a table; it is required where there is no default."""
    value, name = table.get(key, default), f"{where}: {key}" if where else key
    if value is None:
        raise ValueError(f"{name} is missing")
    if not is_number(value):
        raise ValueError(f"{name} = {value!r} is not a finite number")
    return float(value)


def whole_of(table: Mapping[str, Any], key: str, default: int | None, least: int) -> int | None:
    """An integer from a table, at least `least`."""
    value = table.get(key, default)
    if value is not None and (type(value) is not int or value < least):
        raise ValueError(f"{key} = {value!r} must be a whole number, at least {least}")
    return value


def _list_of(value: Any, where: str) -> list:
    if not isinstance(value, list):
        raise ValueError(f"{where} = {value!r}; give a list")
    return value


def _numbers(value: Any, where: str) -> tuple[float, ...]:
    if not _list_of(value, where) or not all(map(is_number, value)):
        raise ValueError(f"{where} = {value!r}; give finite numbers")
    return tuple(map(float, value))
