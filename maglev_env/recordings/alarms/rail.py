"""Readings at the end of their range."""

import numpy as np

from maglev_env.recordings.alarms.alarm import Alarm, in_small_units
from maglev_env.recordings.masking import MOST_MASKED, clipped_samples
from maglev_env.rig.rig import Rig

# A command at its limit is what acted. Where it stands as it was recorded, more of it does no harm, up to here.
MOST_LIMITED = 0.5
MOSTLY = 0.9  # of the samples at an extreme value that a set point explains; the rest is between two of its steps
ROUNDING = 1e-6  # of a converter step


def touched_rail(
    name: str,
    column: str,
    raw: np.ndarray,
    values: np.ndarray,
    rate: float,
    start: int = 0,
    rig: Rig | None = None,
    periodic: bool = True,
    wanted: np.ndarray | None = None,
) -> tuple[Alarm | None, np.ndarray]:
    """A reading stays at its extreme value, or reaches the end of the rig's converter.

    Args:
        name: Channel.
        column: One of its columns in the file.
        raw: That column, (samples,).
        values: The channel in SI, (samples,).
        rate: Hz.
        start: Sample of the file at which both begin.
        rig: The nominal rig of one axis, for its converter.
        periodic: The recording is read at the lines of a period; otherwise a command acts as it was recorded.
        wanted: The set point of a displacement in SI, (samples,), where it is recorded.

    Returns:
        The alarm, and the samples at the rail, (samples,) bool.
    """
    at = clipped_samples(raw)
    if name.startswith("force"):  # between the blows of a hammer it rests at its least value
        at &= raw != np.median(raw)
    if wanted is not None:
        at &= ~_as_wanted(raw, values, at, wanted)
    what = "stays at its extreme value"
    if rig is not None and name.startswith("displacement") and rig.adc_bits:
        reach = rig.voltage_range / rig.probe_gain * (1 - 2.0 ** (1 - rig.adc_bits))
        if (beyond := np.abs(values) >= reach).any():
            at, what = at | beyond, f"reaches the converter's range of +-{in_small_units(reach, 'm')}"
    if not at.any():
        return None, at
    acts = name.startswith("command")
    first, few = int(np.argmax(at)), at.mean() <= (MOST_LIMITED if acts and not periodic else MOST_MASKED)
    text = (
        f"channel {name!r} (column {column!r}) is clipped at {raw[first]:g} from {first / rate:.4g} s (sample "
        f"{start + first}) on: it {what} in {at.mean():.2%} of the samples"
    )
    kept = "it is used as it stands, as a limit of the controller acts" if acts else "they are masked"
    text += f"; {kept}" if few else "; nothing can be identified from it: record with less amplitude or gain"
    return Alarm("rail", name, first / rate, text, "warning" if few else "refuse"), at


def _as_wanted(raw: np.ndarray, values: np.ndarray, at: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Samples `at` an extreme value at which a set point is held, but for one converter step, (samples,) bool.

    What a coarse converter reads of a step stays there without a change. A range that ends just there is not told
    from it.
    """
    found = np.zeros(at.size, bool)
    held = np.diff(wanted, prepend=wanted[:1]) == 0
    for level in (raw.max(), raw.min()):
        own, others = at & (raw == level), raw != level
        if own.any() and others.any():
            place = values[own][0]
            step = np.abs(values[others] - place).min()
            near = held & (np.abs(wanted - place) <= (1 + ROUNDING) * step)
            if near[own].mean() >= MOSTLY:
                found |= own
    return found
