"""Estimators: signals in; stiffness, damping and stability out, with their uncertainty. They know no rig."""

from estimation.actuator import ActuatorEstimate, actuator_estimate
from estimation.bands import band_slices, sliding_bands
from estimation.effective import effective_coefficients, pid_effective_coefficients
from estimation.frequency_response import (
    Distortion,
    coherence,
    distortion,
    frequency_response,
    instrumented_response,
    loop_variance,
    pooled_variance,
)
from estimation.iso_14839 import iso_14839_2_zone, iso_14839_3_zone
from estimation.least_squares import LeastSquares, least_squares
from estimation.local_polynomial import local_polynomial
from estimation.low_crest import low_crest
from estimation.max_likelihood import BandEstimate, least_squares_bias, maximum_likelihood
from estimation.modal import ModalEstimate, modal_estimate
from estimation.orthogonal import interleaved_lines, orthogonal_multisines
from estimation.periods import (
    LineStatistics,
    held,
    line_statistics,
    period_spectra,
    split_periods,
    transient_periods,
)
from estimation.sphs import (
    Multisine,
    crest_factor,
    harmonic_range,
    odd_lines,
    odd_random_grid,
    random_phase,
    schroeder_phases,
    sphs,
    synthesise,
)
from estimation.stability_margins import Margins, loop_gain, margin_arrays, margins, peak_sensitivity
from estimation.xy.planar import PlanarEstimate, RowSums, axis_statistics, eight_coefficients, row_sums
from estimation.xy.planar_least_squares import PlanarLeastSquares, planar_least_squares

__all__ = [
    "ActuatorEstimate",
    "BandEstimate",
    "Distortion",
    "LeastSquares",
    "LineStatistics",
    "Margins",
    "ModalEstimate",
    "Multisine",
    "PlanarEstimate",
    "PlanarLeastSquares",
    "RowSums",
    "actuator_estimate",
    "axis_statistics",
    "band_slices",
    "coherence",
    "crest_factor",
    "distortion",
    "effective_coefficients",
    "eight_coefficients",
    "frequency_response",
    "harmonic_range",
    "held",
    "instrumented_response",
    "interleaved_lines",
    "iso_14839_2_zone",
    "iso_14839_3_zone",
    "least_squares",
    "least_squares_bias",
    "line_statistics",
    "local_polynomial",
    "loop_gain",
    "loop_variance",
    "low_crest",
    "margin_arrays",
    "margins",
    "maximum_likelihood",
    "modal_estimate",
    "odd_lines",
    "odd_random_grid",
    "orthogonal_multisines",
    "peak_sensitivity",
    "period_spectra",
    "pid_effective_coefficients",
    "planar_least_squares",
    "pooled_variance",
    "random_phase",
    "row_sums",
    "schroeder_phases",
    "sliding_bands",
    "sphs",
    "split_periods",
    "synthesise",
    "transient_periods",
]
