"""Sliding estimation bands as in D App. C: each starts `overlap` below the end of the one before."""

import numpy as np

MOST = 10_000  # bands


def sliding_bands(frequency: np.ndarray, width: float, overlap: float) -> np.ndarray:
    """Bands that slide over the excited frequencies.

    Args:
        frequency: Excited frequencies (n,), Hz.
        width: Width of a band, Hz.
        overlap: Overlap of successive bands, Hz.

    Returns:
        Bands (bands, 2): lowest and highest frequency, Hz, both included. The first starts at the lowest line; the
        last ends at or below the highest.

    Raises:
        ValueError: No band fits, or a band would hold fewer than two lines.
    """
    if not 0 <= overlap < width:
        raise ValueError(f"overlap {overlap} Hz must be at least 0 and smaller than the width {width} Hz")
    first, last = float(np.min(frequency)), float(np.max(frequency))
    count = int(np.floor((last - first - width) / (width - overlap) + 1e-9)) + 1
    if count > MOST:
        raise ValueError(
            f"an overlap of {overlap:g} Hz gives {count} bands of {width:g} Hz, more than {MOST}: lower it"
        )
    if count < 1:
        raise ValueError(f"no band of {width} Hz fits between the excited lines {first:g} .. {last:g} Hz")
    starts = first + (width - overlap) * np.arange(count)
    bands = np.stack([starts, starts + width], axis=1)
    lines = band_slices(frequency, bands)
    if (lines[:, 1] - lines[:, 0]).min() < 2:
        f_lo, f_hi = bands[(lines[:, 1] - lines[:, 0]).argmin()]
        raise ValueError(f"the band {f_lo:g} .. {f_hi:g} Hz holds fewer than two lines; choose a wider band")
    return bands


def band_slices(frequency: np.ndarray, bands: np.ndarray) -> np.ndarray:
    """Index ranges (bands, 2), stop exclusive, of the sorted frequencies inside each band, both ends included."""
    tolerance = 1e-6
    starts = np.searchsorted(frequency, bands[:, 0] - tolerance)
    stops = np.searchsorted(frequency, bands[:, 1] + tolerance)
    return np.stack([starts, stops], axis=1)
