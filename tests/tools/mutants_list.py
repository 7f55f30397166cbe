"""The mutants: small wrong changes of signs, factors, indices and statistics that the test-suite must notice."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """breaks: what is wrong, in words. snippets: (old, new) texts; the first whose old text is in the product code
    `count` times is applied everywhere it stands, or in `file` alone. tests: names of the test files to run; select: a
    pytest -k; slow: whether tests marked slow run too."""

    name: str
    breaks: str
    snippets: tuple[tuple[str, str], ...]
    tests: tuple[str, ...]
    select: str = ""
    count: int = 1
    slow: bool = False
    file: str = ""


# Test files that have another name now, or were divided: old name -> new ones.
RENAMED_TESTS: dict[str, tuple[str, ...]] = {}

MUTANTS = (
    # estimation
    Mutant(
        "sphs-phase-rate",
        "Schroeder phases turn half as fast from line to line, so that the crest factor is not low.",
        (
            (
                "return -2 * np.pi * np.concatenate([[0.0], np.cumsum(",
                "return -np.pi * np.concatenate([[0.0], np.cumsum(",
            ),
        ),
        ("test_sphs.py",),
    ),
    Mutant(
        "least-squares-freedom",
        "The residual variance of least squares has the degrees of freedom of five coefficients, not of two.",
        (("freedom = rows - 3", "freedom = rows - 5"),),
        ("test_least_squares.py",),
    ),
    Mutant(
        "band-likelihood-own-noise",
        "The standard error of a band's stiffness takes the pooled noise for that of each of its lines.",
        (("out[q + HR] += hr\n", "out[q + HR] += h\n"),),
        ("test_coverage.py", "test_max_likelihood.py"),
    ),
    Mutant(
        "planar-likelihood-mass",
        "The y axis of the planar likelihood moves with the mass of the x axis.",
        (("complex(t[3] - m[1] * w * w, w * t[7])", "complex(t[3] - m[0] * w * w, w * t[7])"),),
        ("test_planar.py",),
    ),
    Mutant(
        "local-polynomial-freedom",
        "The noise of a local polynomial fit is divided by too many degrees of freedom.",
        (("/ (width - 2 * _TERMS)", "/ (width - _TERMS)"),),
        ("test_local_polynomial.py",),
    ),
    Mutant(
        "delay-margin-half-turn",
        "Delay margins wrap the phase lag at half a turn, so that loops with a lead get too small a margin.",
        (("delay = lag % (2 * np.pi) / ", "delay = lag % np.pi / "),),
        ("test_stability_margins.py",),
    ),
    Mutant(
        "periods-covariance-of-mean",
        "The covariance of line means is that of a single period.",
        (("mean, second / (count - 1) / count, count)", "mean, second / (count - 1), count)"),),
        ("test_periods.py",),
    ),
    Mutant(
        "spin-phase-sign",
        "Lines beside the spin come back with the opposite phase.",
        (
            (
                "complex_ = found[..., 1 : 1 + tones.size] - 1j * found[..., 1 + tones.size :]",
                "complex_ = found[..., 1 : 1 + tones.size] + 1j * found[..., 1 + tones.size :]",
            ),
        ),
        ("test_spin.py",),
    ),
    Mutant(
        "modal-frequency-error",
        "The error of a natural frequency adds those of stiffness and mass with the wrong sign of their covariance.",
        (("natural * np.array([0.5 / k, 0.0, -0.5 / m])", "natural * np.array([0.5 / k, 0.0, 0.5 / m])"),),
        ("test_modal.py",),
        slow=True,
    ),
    # maglev_env: magnets, kernels, linear theory
    Mutant(
        "magnet-saturation-slope",
        "The linearised pull of a saturating magnet bends half as much.",
        (("(1 - (1 - law.creep) * beyond) if", "(1 - 0.5 * (1 - law.creep) * beyond) if"),),
        ("test_magnetics.py", "test_linear_effects.py"),
        "saturated_law or linear",
    ),
    Mutant(
        "kernel-pull-sign",
        "In the kernel the current's pull of a pair falls with the square of the displacement instead of rising.",
        (
            (
                "bent = reach * (field_sum + drive * y) + slope * y2",
                "bent = reach * (field_sum + drive * y) - slope * y2",
            ),
        ),
        ("test_simulate.py",),
    ),
    Mutant(
        "kernel-hysteresis-middle",
        "Hysteresis holds back twice as much current in the middle of an integration step.",
        (("0.5 * (actuator.hold(x, k) + actuator", "(actuator.hold(x, k) + actuator"),),
        ("test_effects_simulated.py",),
        "effect and hysteresis",
        slow=True,
    ),
    Mutant(
        "actuator-moment",
        "The displacement that a changing current makes within a step is halved.",
        (
            ("mean, moment = full[:, 3], 2 * full[:, 4]", "mean, moment = full[:, 3], full[:, 4]"),
            ("c0 = 3 * (2 * displacement) - 2 * middle", "c0 = 3 * displacement - 2 * middle"),
        ),
        ("test_simulate.py",),
    ),
    Mutant(
        "shaft-quarter-turn",
        "Runout and unbalance reach y a quarter of a turn before x: the shaft turns backward.",
        (
            (
                'values.effect("runout", "phase") - axis * np.pi / 2',
                'values.effect("runout", "phase") + axis * np.pi / 2',
            ),
        ),
        ("test_effects_simulated.py", "test_simulate_planar.py"),
        "smooth_effect_agrees or tones or every_effect",
        slow=True,
    ),
    Mutant(
        "linear-cross-damping",
        "Cross damping between the axes pushes instead of holding back.",
        (("pushed[own[other][VELOCITY]] -= damping", "pushed[own[other][VELOCITY]] += damping"),),
        ("test_linear_planar.py",),
    ),
    Mutant(
        "linear-mode-damping",
        "The modes of mount and second body have half the damping in the linear model.",
        (("] = -2 * damping_ratio * turn", "] = -damping_ratio * turn"),),
        ("test_linear_effects.py",),
    ),
    Mutant(
        "eddy-rates",
        "The branches of eddy currents take hertz for radians per second.",
        (("return 1 - weights.sum(axis=-1), weights, 2 * np.pi * hz", "return 1 - weights.sum(axis=-1), weights, hz"),),
        ("test_eddy.py",),
    ),
    Mutant(
        "pid-derivative-sign",
        "The differentiator's low-pass adds to the linear controller instead of being taken off.",
        (("np.array([-slope, controller.ki])", "np.array([slope, controller.ki])"),),
        ("test_controllers.py",),
    ),
    Mutant(
        "excitation-against-axis",
        "A force against an axis counts as along it.",
        (("direction=0.0 if c > 0 else 180.0", "direction=0.0 if c > 0 else 0.0"),),
        ("test_excitation.py",),
    ),
    Mutant(
        "score-displacement-power",
        "The displacement's score term falls with the square instead of the fourth power.",
        (("(displacement / (0.3 * target.clearance)) ** 4", "(displacement / (0.3 * target.clearance)) ** 2"),),
        ("test_evaluate.py", "test_rotor_evaluation.py"),
    ),
    # maglev_env: identification, evaluation, recordings
    Mutant(
        "gain-uncertainty-inertia",
        "An uncertain actuator gain widens the stiffness as if the inertia did not count (known to have survived).",
        (
            (
                "_widened(band, share * (band.stiffness - mass * w**2), share",
                "_widened(band, share * band.stiffness, share",
            ),
        ),
        ("test_identify.py",),
    ),
    Mutant(
        "evaluation-peak-error",
        "The standard error of the peak sensitivity is that of a complex number, not of its size.",
        (
            (
                "ms_se = np.sqrt(variance[np.arange(len(nearest)), nearest] / 2)",
                "ms_se = np.sqrt(variance[np.arange(len(nearest)), nearest])",
            ),
        ),
        ("test_evaluate.py",),
    ),
    Mutant(
        "recording-offset-scaled",
        "A channel's offset is multiplied by its scale.",
        (("return value + source.offset if", "return value + source.scale * source.offset if"),),
        ("test_recording.py",),
    ),
    # maglev_env: rotors
    Mutant(
        "run-up-radial-peak",
        "The radial peak of a run-up is that of x alone (known to have survived).",
        (
            (
                "np.hypot(channels[:, 0:4:2], channels[:, 1:4:2]).max(axis=-1)",
                "np.abs(channels[:, 0:4:2]).max(axis=-1)",
            ),
        ),
        ("test_rotor_evaluation.py",),
    ),
    Mutant(
        "run-up-axial-reading",
        "The axial probe of a run-up reads half the displacement (known to have survived).",
        (("axial = moving[:, 8] + (reach", "axial = 0.5 * moving[:, 8] + 0.5 * (reach"),),
        ("test_rotor_evaluation.py",),
    ),
    Mutant(
        "rotor-gyroscopic-sign",
        "In the rotor's kernel one of the two gyroscopic moments has the wrong sign.",
        (("* per_inertia + gyro * v1", "* per_inertia - gyro * v1"),),
        ("test_rotor_simulate.py",),
    ),
    # selfsense
    Mutant(
        "bound-density",
        "The lowest noise density of a sensed gap is the two-sided one, the square root of two too small.",
        (("np.sqrt(2 / (sensor.acquisition.rate * power))", "np.sqrt(1 / (sensor.acquisition.rate * power))"),),
        ("test_bound.py",),
    ),
    Mutant(
        "averaged-motion-voltage",
        "In the averaged magnet the voltage of a changing inductance has the wrong sign.",
        (
            (
                "return v, pull / m.mass, (voltage - m.resistance * i - (m.emf + slope * i) * v)",
                "return v, pull / m.mass, (voltage - m.resistance * i - (m.emf - slope * i) * v)",
            ),
        ),
        ("test_observers.py",),
    ),
    Mutant(
        "coil-dead-time-edge",
        "Dead time puts off the falling edge for currents of the wrong sign.",
        (
            (
                "against = current(x, k, edge) * (on - off) < 0.0",
                "against = current(x, k, edge) * (on - off) > 0.0",
            ),
        ),
        ("test_coil.py",),
        "dead_time",
    ),
    Mutant(
        "baseband-delay",
        "A self-sensor's baseband model delays twice as long as its forward path.",
        (
            (
                "delay = -np.angle(forward / low_pass) / (2 * np.pi * PROBED)",
                "delay = -np.angle(forward / low_pass) / (np.pi * PROBED)",
            ),
        ),
        ("test_self_sensing.py",),
        "sensitivity_is_that_of_the_linear_loop",
        slow=True,
    ),
    Mutant(
        "calibration-offset-error",
        "The offset of a static calibration is as certain as if its displacements were centred.",
        (
            (
                "np.hypot(np.sqrt(variance / spread.size), gain_se * x[inside].mean())",
                "np.sqrt(variance / spread.size)",
            ),
        ),
        ("test_calibration.py",),
    ),
    # sim2real
    Mutant(
        "opened-converter-noise",
        "The noise that the converters' resolution makes of a line is halved.",
        (
            (
                "step**2 / 12 * 4 / np.clip(4 * passed, 1, samples)",
                "step**2 / 12 * 2 / np.clip(4 * passed, 1, samples)",
            ),
        ),
        ("test_opened.py",),
    ),
    Mutant(
        "judge-cost-factor",
        "The judge takes differences of cost for differences of log-likelihood, twice what they are.",
        (
            (
                "likelihood = -0.5 * belief.freedom * np.log1p(np.maximum",
                "likelihood = -belief.freedom * np.log1p(np.maximum",
            ),
        ),
        ("test_judge.py",),
    ),
    Mutant(
        "shrink-damping-words",
        "The damping told in an engineer's words is not weighted by the frequency.",
        (
            (
                "damping = float((weight * dynamic.imag * omega).sum() / (weight * omega**2).sum())",
                "damping = float((weight * dynamic.imag).sum() / (weight * omega**2).sum())",
            ),
        ),
        ("test_shrink.py",),
        slow=True,
    ),
    Mutant(
        "fitting-prior-sign",
        "The prior drives a fit away from the nominal parameters.",
        (
            (
                "real_product(self.jacobian, self.residual) - self.prior * self.u",
                "real_product(self.jacobian, self.residual) + self.prior * self.u",
            ),
        ),
        ("test_fitting.py",),
        file="sim2real/search/fit.py",
    ),
    Mutant(
        "tones-phase-sign",
        "The amplitude of a tone has the opposite phase.",
        (("return coefficients[0] - 1j * coefficients[1]", "return coefficients[0] + 1j * coefficients[1]"),),
        ("test_tones_between_lines.py",),
    ),
    # tuning
    Mutant(
        "rule-negative-stiffness",
        "The dissertation's rule takes the magnets' negative stiffness off the gain instead of making up for it.",
        (
            (
                "(self._target.stiffness - rig.support_stiffness - negative) / gain",
                "(self._target.stiffness - rig.support_stiffness + negative) / gain",
            ),
        ),
        ("test_recommendation.py",),
        "rule",
        slow=True,
    ),
    Mutant(
        "gain-box-range",
        "Ranges that are divided linearly reach too far up.",
        (("straight = self.low + (self.high - self.low) * unit", "straight = self.low + self.high * unit"),),
        ("test_env_parts.py",),
    ),
    Mutant(
        "recommendation-interval",
        "The intervals over noise and tolerance that a recommendation rests on hold 90 instead of 95 percent.",
        (
            (
                "_ENDS = (50 * (1 - LEVEL), 50 * (1 + LEVEL))",
                "_ENDS = (100 * (1 - LEVEL), 100 * LEVEL)",
            ),
        ),
        ("test_recommendation.py",),
        "safe_is_recommended or intervals_of_a_verdict",
        slow=True,
    ),
)
