"""Where mutants are sampled: files of physics, statistics and units, and the tests that are to find them."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """file: of the product. mutants: how many are drawn. tests, select, slow: as of a `Mutant`."""

    file: str
    mutants: int
    tests: tuple[str, ...]
    select: str = ""
    slow: bool = False


LIKELIHOOD = ("test_max_likelihood.py", "test_coverage.py")
LIKELIHOOD_ALONE = "max_likelihood or fit_p or shows_a_frequency"
LINEAR = ("test_linear_effects.py", "test_linear.py")
LANES = (*LINEAR, "test_effects_simulated.py")
PLANAR = ("test_planar.py", "test_planar_coverage.py")
ROTOR = ("test_rotor_linear.py", "test_rotor_quantities.py")

TARGETS: tuple[Target, ...] = (
    # statistics
    Target("estimation/band_mean.py", 6, ("test_band_mean.py",)),
    Target("estimation/band_search.py", 8, LIKELIHOOD, LIKELIHOOD_ALONE),
    Target("estimation/band_sums.py", 6, LIKELIHOOD, LIKELIHOOD_ALONE),
    Target("estimation/band_errors.py", 8, LIKELIHOOD, LIKELIHOOD_ALONE),
    Target("estimation/band_bounds.py", 5, LIKELIHOOD, LIKELIHOOD_ALONE),
    Target("estimation/band_likelihood.py", 5, LIKELIHOOD, LIKELIHOOD_ALONE),
    Target("estimation/max_likelihood.py", 4, LIKELIHOOD, LIKELIHOOD_ALONE),
    Target("estimation/bands.py", 2, ("test_bands.py",)),
    Target("estimation/least_squares.py", 5, ("test_least_squares.py",)),
    Target("estimation/modal.py", 5, ("test_modal.py",)),
    Target("estimation/actuator.py", 3, ("test_actuator.py",)),
    Target("estimation/apparent_gain.py", 5, ("test_apparent_gain.py",)),
    Target("estimation/stability_margins.py", 6, ("test_stability_margins.py",)),
    Target("estimation/margin_errors.py", 4, ("test_margin_errors.py",)),
    Target("estimation/gain_margin.py", 4, ("test_gain_margin.py",)),
    Target("estimation/stiffness_pole.py", 3, ("test_stiffness_pole.py",)),
    Target("estimation/effective.py", 4, ("test_effective.py",)),
    Target("estimation/lines/periods.py", 6, ("test_periods.py", "test_changes.py")),
    Target("estimation/lines/frequency_response.py", 6, ("test_frequency_response.py",)),
    Target("estimation/lines/curves.py", 5, ("test_curves.py", "test_stability_margins.py")),
    Target("estimation/lines/local_polynomial.py", 5, ("test_local_polynomial.py",)),
    Target("estimation/lines/smooth_loop.py", 5, ("test_smooth_loop.py",)),
    Target("estimation/lines/line_windows.py", 6, ("test_line_windows.py",)),
    Target("estimation/lines/tones.py", 6, ("test_tones_between_lines.py", "test_record_spectra.py")),
    Target("estimation/lines/spin.py", 4, ("test_spin.py",)),
    Target("estimation/online/change_charts.py", 4, ("test_change_charts.py",)),
    Target("estimation/online/line_block.py", 4, ("test_tracking.py",)),
    Target("estimation/online/tracking.py", 4, ("test_tracking.py",)),
    Target("estimation/multisine/sphs.py", 5, ("test_sphs.py",)),
    Target("estimation/multisine/low_crest.py", 2, ("test_low_crest.py",)),
    Target("estimation/xy/planar_least_squares.py", 4, ("test_planar_least_squares.py",)),
    Target("estimation/xy/planar_likelihood.py", 6, PLANAR),
    Target("estimation/xy/planar.py", 3, PLANAR),
    Target("estimation/xy/planar_distortion.py", 5, (*PLANAR, "test_planar_distortion.py"), slow=True),
    Target("maglev_lanes/noise.py", 3, ("test_simulate.py", "test_defaults.py"), "noise"),
    Target("maglev_lanes/line_spectra.py", 3, ("test_line_spectra.py",)),
    Target("maglev_lanes/period_statistics.py", 4, ("test_line_spectra.py",)),
    Target("sim2real/compared/drift.py", 3, ("test_drift.py",), slow=True),
    Target("sim2real/judgement/dispersion.py", 3, ("test_dispersion.py",), slow=True),
    # physics
    Target("maglev_env/loop/magnets/law.py", 6, ("test_magnetics.py", "test_force_law.py")),
    Target("maglev_env/loop/magnets/energy.py", 4, ("test_magnetics.py", "test_force_law.py")),
    Target("maglev_env/loop/magnets/circuit.py", 4, ("test_magnetics.py",)),
    Target("maglev_env/loop/magnets/hybrid_pair.py", 3, ("test_magnet_pieces.py",)),
    Target("maglev_env/loop/eddy.py", 2, ("test_eddy.py", "test_effects_simulated.py"), slow=True),
    Target("maglev_env/loop/actuator.py", 2, LANES, slow=True),
    Target("maglev_env/loop/amplifier.py", 2, LANES, slow=True),
    Target("maglev_env/loop/mechanics.py", 3, (*LANES, "test_presliding.py"), slow=True),
    Target("maglev_env/loop/sensor.py", 2, LANES, slow=True),
    Target("maglev_env/loop/second_body.py", 2, LANES, slow=True),
    Target("maglev_env/loop/saturation.py", 3, ("test_single_saturation.py",), slow=True),
    Target("maglev_env/loop/filtered_pid.py", 3, ("test_filtered_pid.py",)),
    Target("maglev_env/loop/linear_controller.py", 3, ("test_controller_forms.py", "test_filtered_pid.py")),
    Target("maglev_env/linear/axis.py", 3, (*LINEAR, "test_free_corrections.py"), "linear", slow=True),
    Target("maglev_env/linear/loop.py", 5, (*LINEAR, "test_linear_planar.py")),
    Target("maglev_env/linear/step_load.py", 2, ("test_step_load.py",)),
    Target("maglev_env/rotor/linear.py", 5, ROTOR),
    Target("maglev_env/rotor/parts.py", 3, ("test_rotor_file.py", *ROTOR)),
    Target("maglev_env/rotor/rotor.py", 2, ("test_rotor_file.py", *ROTOR)),
    Target("maglev_env/rotor/loop_quantities.py", 3, ROTOR),
    Target("maglev_env/evaluation/known_chain.py", 4, ("test_known_chain.py", "test_identify.py")),
    Target("maglev_env/evaluation/score.py", 3, ("test_evaluate.py",)),
    Target("maglev_env/evaluation/late_step.py", 3, ("test_late_step.py",), slow=True),
    Target("maglev_env/design/motor.py", 4, ("test_design_motor.py",)),
    Target("maglev_env/design/hydraulics.py", 4, ("test_design_hydraulics.py",)),
    Target("maglev_env/design/stator.py", 3, ("test_design_stator.py",)),
    Target("maglev_env/design/thermal.py", 3, ("test_design_thermal.py",)),
    Target("maglev_env/design/pid_rules.py", 3, ("test_design_pid_rules.py",)),
    Target("selfsense/bound.py", 3, ("test_bound.py",)),
    Target("selfsense/coil.py", 2, ("test_coil.py",)),
    Target("selfsense/linear.py", 4, ("test_linear_sensor.py",)),
    Target("selfsense/calibration/static.py", 4, ("test_calibration.py",)),
    # units
    Target("maglev_env/units.py", 3, ("test_units.py",)),
    Target("maglev_env/recordings/measurement_chain.py", 4, ("test_measurement_chain.py",)),
)

# Sampled mutants that no test can find, because what they change decides nothing: how far a search goes on, what a
# graceful limit is. Each with its reason.
EQUIVALENT: Mapping[str, str] = {
    "smooth_loop.smooth: - -> + in m - 2": "fills two places that nothing reads",
    "stability_margins._intervals: + -> - in centre + noise[0] + 1j * noise[1]": "the sign of symmetric noise",
    "band_mean.band_mean: + -> - in abs(start[0]) / w.mean() + mass * w.mean()": "scales the search",
    "band_mean.variance: + -> - in sff + floor": "the floor is 1e-12 of the force and serves records without noise",
    "change_charts.cusum_threshold: * -> / in 2 * allowance ** 2": "an upper end of a search",
    "sphs._scaled: 2 -> 3 in 2 * share": "a scale that the stated peak sets anew",
    "parts.damping: 1e-3 -> 0.002 in 0.001 * (1 - r)": "an end of a bracket of a root",
    "motor._check_reaches: > -> <= in net > 0": "a check that raises",
    "band_search._step: 1e-14 -> 2e-14 in 1e-14 * akk": "where a Hessian counts as singular, which rounding decides",
    "band_errors.estimate: - -> + in n - 1": "stands in for an optimum at infinity, of which nothing is told",
    "band_errors.estimate: 1 -> 2 in n - 1": "likewise",
    "band_errors._starts: - -> + in across - noise * w1 * pi": "a start of the search",
    "band_likelihood.bands_of: - -> + in f_im * y_re - f_re * y_im": "a start of the search",
    "band_bounds._bound: / -> * in g_in / 2": "how fast a search closes in",
    "planar_likelihood.estimate: 8.0 -> 16.0 in 4.0 * w.size - 8.0": "as in band_errors: of an optimum at infinity",
    "gain_margin.at_rest: / -> * in s / scale": "scales a column of a least squares problem",
    "curves.crossings: > -> <= in level > 0": "where a curve changes its sign its opposite does",
    "planar_likelihood.estimate: - -> + in 4.0 * w.size - 8.0": "of an optimum at infinity, of which nothing is told",
    "modal.global_fit: 1e-14 -> 2e-14 in power * 1e-14": "an end of a bracket",
    "modal._by_chance: 3 -> 4 in equal - 3": "moves a p-value by 1 %, which 600 simulated records do not see",
    "modal._by_chance: 2 -> 3 in n - 2": "moves a p-value by less than 0.2 %",
    "smooth_loop.smooth: 1 -> 2 in WIDTHS - 1": "how finely a search's grid lies",
    "line_windows.line_windows: 1e-6 -> 2e-06 in low * samples / sample_rate - 1e-06": "a guard against rounding",
}
