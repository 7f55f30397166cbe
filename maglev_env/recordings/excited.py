"""Whether a recording was driven where its campaign says so: declared lines without power are named."""

from typing import TYPE_CHECKING

import numpy as np

from estimation.lines.periods import period_drift, period_spectra, split_periods
from maglev_env.channels import SHOWN_BY
from maglev_env.loop.axes import AXES
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.recordings.clock import CLEAR, TURNED
from maglev_env.rig.excitation import Excitation

if TYPE_CHECKING:
    import xarray as xr

# A line is driven where it exceeds so many standard deviations of its mean, and this share of the strongest line.
LINE_SIGNIFICANCE, LINE_FLOOR = 3.0, 1e-6
LINES_SHOWN = 8  # of those without excitation that a message lists


def check_excited(dataset: "xr.Dataset", spec: RecordingSpec) -> None:
    """Check that the channel of a periodic excitation carries every line that it states: force, injection, reference.

    A line counts when its mean amplitude over periods exceeds 3 standard deviations of that mean, and 1e-6 of the
    strongest line. Nothing is checked without such an excitation or its channel.

    Raises:
        ValueError: A line is missing.
    """
    for excitation in spec.excitations:
        if excitation.periodic:
            name, driven = _along(dataset, excitation)
            if driven is not None:
                block = excitation.block(spec.sample_rate)
                _check_lines(name, driven, np.array(excitation.lines), block, excitation.fundamental, spec.sample_rate)


def _along(dataset: "xr.Dataset", excitation: Excitation) -> tuple[str, np.ndarray | None]:
    """What drives along an excitation's direction and, on an x-y rig, across it, (1 or 2, samples).

    With it comes the name of its channel; None where it was not recorded.
    """
    place = SHOWN_BY[excitation.at]
    planar = [f"{place}_{axis}" for axis in AXES]
    if all(name in dataset for name in planar):
        x, y = (dataset[name].values for name in planar)
        c, s = excitation.components
        return place, np.array([c * x + s * y, c * y - s * x])
    found = [name for name in map(str, dataset.data_vars) if name.partition("_")[0] == place]
    return (found[0], dataset[found[0]].values[None]) if len(found) == 1 else (place, None)


def other_clock(ppm: float, rate: float) -> str:
    """What is wrong, and what to do, where a recorder's clock is fast by some ppm."""
    return (
        f"the recorder's clock is {abs(ppm):.3g} ppm {'fast' if ppm > 0 else 'slow'} against that of the excitation: "
        f"drive both by one clock, or resample the recording, whose true rate is {rate * (1 + 1e-6 * ppm):.9g} Hz"
    )


def _check_lines(
    name: str, driven: np.ndarray, lines: np.ndarray, block: tuple[int, int], fundamental: float, rate: float
) -> None:
    periods = split_periods(driven, block[0])
    # The first period may contain the start of the excitation.
    spectra = np.array([period_spectra(p, lines * block[1]) for p in periods[1 if len(periods) > 2 else 0 :]])
    whole = np.abs(spectra.mean(axis=0))
    amplitude, noise = whole[0], np.sqrt(spectra.var(axis=0, ddof=1)[0] / len(spectra))
    missing = (amplitude <= LINE_SIGNIFICANCE * noise) | (amplitude <= LINE_FLOOR * whole.max())
    if missing.any():
        w = 2 * np.pi * lines * block[1] / block[0]
        ahead, error = period_drift(spectra[:, 0], w) or (0.0, 0.0)
        if abs(ahead) > CLEAR * error and abs(ahead) * len(spectra) * w[-1] > TURNED:
            raise ValueError(f"channel {name!r}: {other_clock(-1e6 * ahead / block[0], rate)}")
        shown = ", ".join(f"{n} ({n * fundamental:g} Hz)" for n in lines[missing][:LINES_SHOWN])
        more = f" and {missing.sum() - LINES_SHOWN} more" if missing.sum() > LINES_SHOWN else ""
        raise ValueError(
            f"channel {name!r}: no excitation at line {shown}{more}: at {missing.sum()} of {lines.size} stated "
            "lines in all; correct the excitation's lines, fundamental or start"
        )
