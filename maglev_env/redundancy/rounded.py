"""Lines on which a channel holds nothing but what its file's digits have rounded."""

from dataclasses import replace

import numpy as np

from maglev_env.redundancy.view import View

LEAST_LEVELS = 30  # fewer are steps of the signal itself, not of its digits
UNEVEN = 0.02  # of the step: how far a reading may lie beside the grid of its digits
CLEARLY = 3.0  # times what rounding leaves: a signal


def digit(values: np.ndarray) -> float:
    """The step of the digits that values (samples,) are stored with; 0.0 where they are on no such grid."""
    levels = np.unique(values)
    steps = np.diff(levels)
    steps = steps[steps > 1e-6 * steps.max(initial=0.0)]  # smaller ones are the last bits of one level
    if steps.size < LEAST_LEVELS:
        return 0.0
    step = float(steps.min())
    return step if np.abs(steps / step - np.round(steps / step)).max() < UNEVEN else 0.0


def told(view: View, name: str) -> np.ndarray:
    """On which lines (n,) a channel is more than its rounding, which whoever used the channel has never seen."""
    spectra = view.lines.parts[name]
    step = digit(view.channels[name])
    if not step:
        return np.ones(spectra.shape[-1], bool)
    noise = np.random.default_rng(0).uniform(-step / 2, step / 2, view.channels[name].size)
    left = replace(view, channels={**view.channels, name: noise}).lines.parts[name]
    if view.lines.periodic:  # the mean over periods is what is compared
        return np.abs(spectra.mean(axis=0)) > CLEARLY * np.sqrt((np.abs(left.mean(axis=0)) ** 2).mean())
    return (np.abs(spectra) ** 2).mean(axis=0) > CLEARLY**2 * (np.abs(left) ** 2).mean()
