"""From a recording to its estimate: known rigs come back, and what cannot be known is said."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import stats
from scipy.interpolate import CubicSpline

from estimation.band_mean import band_mean
from estimation.bands import band_slices
from estimation.lines.frequency_response import frequency_response
from estimation.max_likelihood import maximum_likelihood
from estimation.stability_margins import margins as margins_of_all_draws
from maglev_env.design.protocols import diagnosis_campaign, sphs_campaign
from maglev_env.evaluation import identification, stability
from maglev_env.evaluation.identification import identify
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import LinearController
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.files import write_csv
from maglev_env.recordings.quality import recording_quality
from maglev_env.recordings.recording import read_recording, simulated_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import load_rig, rig_from_toml

# The 2000 draws of each estimate would take most of the time; how well they cover is counted where margins are tested.
margins = partial(margins_of_all_draws, draws=400)


@pytest.fixture(autouse=True, scope="module")
def fewer_draws():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stability, "margins", margins)
        yield


def recorded(e, held=True):
    dataset = simulated_recording(e, simulate_records([e])[0])
    channels = {str(n): dataset[n].values for n in dataset.data_vars}
    gains = e.gains if e.rig.controlled else None
    return RecordedSignals(channels, e.rig.control_rate, e.excitations, e.rig.control_rate if held else None, gains)


@pytest.fixture(scope="module")
def pedestal():
    rig = load_rig("pedestal")
    return rig, recorded(protocol_experiment(rig, seed=1))


@pytest.fixture(scope="module")
def levitated():
    rig = load_rig("hmb_free")
    return rig, recorded(protocol_experiment(rig, seed=1))


def test_constant_stiffness_and_damping_come_back_inside_their_intervals(pedestal):
    rig, signals = pedestal
    found = identify(signals, rig, rig.mass)
    hits = [b.stiffness_ci[0] <= rig.support_stiffness <= b.stiffness_ci[1] for b in found.bands]
    damped = [b.damping_ci[0] <= rig.support_damping <= b.damping_ci[1] for b in found.bands]
    assert np.mean(hits) > 0.85 and np.mean(damped) > 0.85
    assert found.natural_frequency == pytest.approx(np.sqrt(134.5e3 / 0.79) / (2 * np.pi), abs=0.01)
    assert found.damping_ratio == pytest.approx(8 / (2 * np.sqrt(134.5e3 * 0.79)), rel=0.01)
    assert found.stability is None and any("margins" in n for n in found.notes)


def test_a_damping_of_unknown_sign_is_no_damping_ratio(pedestal):
    rig, signals = pedestal
    bands = identify(signals, rig, rig.mass).bands
    blurred = tuple(replace(b, damping_ci=(-1.0, 20.0)) for b in bands)
    assert identification._crossing(bands, rig.mass)[1] > 0
    assert identification._crossing(blurred, rig.mass) == (identification._crossing(bands, rig.mass)[0], None)


def test_without_the_hold_correction_the_damping_is_k_t_over_two_too_large(pedestal):
    rig, signals = pedestal
    raw = identify(replace(signals, hold_rate=None), rig, rig.mass)
    low = raw.bands[3]
    assert low.damping - rig.support_damping == pytest.approx(rig.support_stiffness * 25e-6, rel=0.4)


def test_the_mass_can_be_estimated_with_the_rest(pedestal):
    _, signals = pedestal
    found = identify(signals, None, None, estimate_mass=True, band_width=10.0, band_overlap=8.0)
    m = found.modal
    assert abs(m.mass - 0.79) < 4 * m.mass_se < 0.01
    assert abs(m.natural_frequency - 65.67) < 0.01
    known = identify(signals, None, 0.79, band_width=10.0, band_overlap=8.0)
    for with_it, without in zip(found.bands, known.bands, strict=True):
        # What is not known of the mass is not known of the stiffness, w^2 as much.
        shift = m.mass_se * (np.pi * (with_it.f_lo + with_it.f_hi)) ** 2
        assert with_it.stiffness_se == pytest.approx(np.hypot(without.stiffness_se, shift), rel=0.02)
    with pytest.raises(ValueError, match="--estimate-mass"):
        identify(signals, None, None)


def test_margins_are_measured_with_an_injection_and_labelled_without(levitated):
    rig, signals = levitated
    measured = identify(signals, rig, rig.mass).stability
    assert measured.source == "injection"
    low, high = measured.margins.intervals["peak_sensitivity"]
    assert low < 2.472 < high and measured.iso_14839_3_zone == "A"
    no_injection = {k: v for k, v in signals.channels.items() if k not in ("injection", "command")}
    bare = replace(signals, channels=no_injection)
    assumed = identify(bare, rig, rig.mass)
    assert assumed.stability.source == "assumes the nominal actuator"
    assert assumed.stability.margins.peak_sensitivity == pytest.approx(2.47, abs=0.05)
    assert assumed.stability.margins.gain_margin_high is None
    assert "gain_margin_high" in assumed.stability.margins.reasons
    assert identify(bare, None, rig.mass).stability is None


def test_margins_know_from_how_many_periods_their_noise_is(levitated):
    """Seven neighbouring lines of two periods have 14 degrees of freedom: a twelfth more than a known noise asks."""
    rig, signals = levitated
    samples = signals.excitations[0].block(signals.sample_rate)[0]
    two = {name: values[-2 * samples :] for name, values in signals.channels.items()}
    found = identify(replace(signals, channels=two), rig, rig.mass).stability
    here, known = (margins(found.frequency, found.sensitivity, found.variance, freedom=n) for n in (14, np.inf))
    assert found.margins.intervals == here.intervals
    wider = np.subtract(*here.intervals["phase_margin"]) / np.subtract(*known.intervals["phase_margin"])
    assert wider == pytest.approx(stats.t.ppf(0.975, 14) / stats.norm.ppf(0.975), abs=0.1)


def test_actual_coefficients_stand_beside_the_effective_ones(levitated):
    rig, signals = levitated
    band = next(b for b in identify(signals, rig, rig.mass).bands if b.f_lo > 60)
    # The sampled derivative is (z - 1) / (z - a) / td: 27 % steeper than kd s. Lags of amplifier, probe and hold then
    # take more than that away: the gains promise more damping than there is.
    assert band.effective_damping == pytest.approx(5.7 * 5.2 * 0.5 / (1 - np.exp(-0.5)), rel=0.07)
    assert band.damping == pytest.approx(29.4, abs=0.5) and band.effective_damping > band.damping + 5
    assert band.effective_stiffness == pytest.approx(band.stiffness, rel=0.05)


def test_a_transient_is_dropped_and_said_so(pedestal):
    rig, signals = pedestal
    found = identify(signals, rig, rig.mass)
    assert found.transient_periods >= 1 and any("transient" in n for n in found.notes)


def test_distortion_shows_on_detection_lines_only():
    rig = load_rig("hmb_free")
    plan = {p.name: p for p in diagnosis_campaign(rig, rig.gains, {}, 0)}
    assert set(plan) == {"base", "phases", "half", "gains", "offset", "holdout"}
    assert plan["holdout"].role == "holdout" and plan["base"].role == "fit"
    full = identify(recorded(plan["base"].experiment), rig, rig.mass).distortion
    assert full.even is not None and full.odd is not None
    centred, offset = full, identify(recorded(plan["offset"].experiment), rig, rig.mass).distortion
    # A rotor off its centre meets a force law without the symmetry that hides even distortion.
    assert centred.even_p > 1e-3 and offset.even_p < 1e-6
    sphs = identify(recorded(sphs_campaign(rig, rig.gains, {}, 0)[0].experiment), rig, rig.mass)
    assert sphs.distortion.even is None and any("detection" in n for n in sphs.notes)


def test_quality_tells_what_a_record_is_good_for(levitated):
    _, signals = levitated
    good = recording_quality(signals)
    assert good.can["margins"] == "yes" and good.can["stiffness and damping"] == "yes"
    assert good.can["nonlinear distortion"].startswith("no") and all(b.verdict == "good" for b in good.bands)
    axial = load_rig("hmb_axial")
    weak = recording_quality(recorded(protocol_experiment(axial)))
    assert weak.bands[0].verdict == "good" and weak.bands[-1].verdict == "noise rules"
    assert any("lost in noise" in p for p in weak.problems)
    assert weak.can["margins"].startswith("no") and weak.can["amplifier block"].startswith("no")


def test_mistakes_of_scale_and_sign_are_pointed_out(pedestal):
    rig, signals = pedestal
    huge = replace(signals, channels=signals.channels | {"displacement": signals.channels["displacement"] * 1e3})
    assert any("clearance" in p for p in recording_quality(huge, rig).problems)
    assert not any("clearance" in p for p in recording_quality(signals, rig).problems)
    flipped = replace(signals, channels=signals.channels | {"force": -signals.channels["force"]})
    assert any("sign" in n for n in identify(flipped, rig, rig.mass).notes)
    assert not any("sign" in n for n in identify(signals, rig, rig.mass).notes)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_below_the_resonance_a_flipped_sign_is_not_denied(sign):
    """A support of 100 Hz, pushed at 10 to 58 Hz: of -(k - m w^2) all lines are negative, as those of a mass are."""
    mass, rate, n = 0.5, 2000.0, 1000
    lines = np.arange(5, 30)
    w = 2 * np.pi * 2.0 * lines
    force = np.exp(2j * np.pi * np.random.default_rng(5).random(lines.size))
    stiffness = mass * (2 * np.pi * 100.0) ** 2 - mass * w**2 - sign * 20j * w  # either has a negative damping
    channels = {}
    for name, amplitude in (("force", force), ("displacement", sign * force / stiffness)):
        spectrum = np.zeros(n // 2 + 1, complex)
        spectrum[lines] = amplitude * n / 2
        channels[name] = np.tile(np.fft.irfft(spectrum, n), 4)
    channels["displacement"] += 1e-9 * np.random.default_rng(6).normal(size=4 * n)
    excitation = Excitation("sphs", "force", 2.0, tuple(map(int, lines)), 1.0)
    notes = identify(RecordedSignals(channels, rate, (excitation,)), None, mass).notes
    (said,) = [note for note in notes if "damping is negative" in note]
    assert ("right sign" in said) == (sign > 0) and ("flipped?" in said) == (sign < 0)


def test_what_is_missing_is_named(pedestal):
    rig, signals = pedestal
    without = replace(signals, channels={"displacement": signals.channels["displacement"]})
    with pytest.raises(ValueError, match="the channel force"):
        identify(without, rig, rig.mass)


def test_a_linear_controller_that_is_the_pid_gives_the_pids_margins(levitated):
    rig, signals = levitated
    g, dt = rig.gains, 1 / rig.control_rate
    a_d, a_i = np.exp(-dt / g.td), np.exp(-dt / g.ti)
    numerator = (g.kp + g.kd / g.td) * np.poly([a_d, a_i]) - g.kd / g.td * (1 - a_d) * np.poly([a_i, 0])[[2, 0, 1]]
    numerator += g.ki * (1 - a_i) * np.poly([a_d, 0])[[2, 0, 1]]
    alike = LinearController(tuple(numerator), tuple(np.poly([a_d, a_i])))
    bare = {k: v for k, v in signals.channels.items() if k in ("force", "displacement")}
    pid, linear = (
        identify(replace(signals, channels=bare, gains=gains), rig, rig.mass, band_overlap=0.0) for gains in (g, alike)
    )
    assert linear.stability.source == "assumes the nominal actuator"
    assert linear.stability.margins.peak_sensitivity == pytest.approx(pid.stability.margins.peak_sensitivity, rel=1e-6)
    for one, other in zip(linear.bands, pid.bands, strict=True):
        assert one.effective_stiffness == pytest.approx(other.effective_stiffness, rel=1e-9)
        assert one.effective_damping == pytest.approx(other.effective_damping, rel=1e-6)


@pytest.fixture(scope="module", params=[None, 8000.0, 2000.0, 1000.0])
def at_rate(request, tmp_path_factory):
    """The pedestal controlled at 4 kHz, recorded at another rate, as a campaign folder."""
    rig = with_parameters(load_rig("pedestal"), {"control_rate": 4000.0})
    e = replace(protocol_experiment(rig, seed=2), sample_rate=request.param, periods=6)
    folder = tmp_path_factory.mktemp("rate")
    dataset = simulated_recording(e, simulate_records([e])[0])
    write_campaign(folder, "pedestal", {"control_rate": 4000.0}, [("a", "fit", dataset, e)])
    return folder / "campaign.toml", request.param or 4000.0


def identified(path, text):
    path.write_text(text)
    campaign = load_campaign(path)
    (spec,) = campaign.recordings
    signals = recorded_signals(campaign, spec, read_recording(campaign, spec))
    return signals, identify(signals, campaign.rig, campaign.mass, band_width=10.0, band_overlap=0.0)


def test_any_recorded_rate_gives_the_same_stiffness_and_damping(at_rate):
    path, rate = at_rate
    text = path.read_text()
    hold = 'intersample = "zoh"\n'
    assert f"sample_rate = {rate}" in text and hold in text
    for stated in (hold, ""):
        signals, found = identified(path, text.replace(hold, stated))
        assert signals.hold_rate == max(rate, 4000.0) and len(found.bands) == 9
        for value, name in ((134.5e3, "stiffness"), (8.0, "damping")):
            z = [(getattr(b, name) - value) / getattr(b, f"{name}_se") for b in found.bands]
            assert stats.chi2.sf(np.sum(np.square(z)), 9) > 1e-3, name
    # Half a sample of the hold is (k - m w^2) dt / 2 of damping: many standard errors.
    _, wrong = identified(path, text.replace(hold, 'intersample = "bl"\n'))
    path.write_text(text)
    below = slice(1, 5)  # 10 .. 50 Hz: near the resonance no constant damping fits the late force
    off, se, w = np.array([(b.damping - 8.0, b.damping_se, np.pi * (b.f_lo + b.f_hi)) for b in wrong.bands[below]]).T
    expected = (134.5e3 - 0.79 * w**2) / (2 * signals.hold_rate)
    assert (np.abs(off - expected) < 4 * se + 0.15 * expected).all()
    assert np.median(off / [b.damping_se for b in found.bands[below]]) > 10


@pytest.mark.parametrize("at_rate", [None], indirect=True)
def test_rates_in_no_integer_ratio_are_refused_only_where_the_hold_needs_them(at_rate):
    path, _ = at_rate
    text = path.read_text().replace("control_rate = 4000.0", "control_rate = 3000.0")
    with pytest.raises(ValueError, match=r"a\.npz: sample_rate = 4000 Hz is neither.*control_rate = 3000 Hz; the held"):
        identified(path, text)
    hold = 'intersample = "zoh"\n'
    for stated, said in (("", True), ('intersample = "bl"\n', False)):
        signals, found = identified(path, text.replace(hold, stated))
        assert signals.hold_rate is None and any("taken as continuous" in n for n in found.notes) == said
    path.write_text(text.replace("control_rate = 3000.0", "control_rate = 4000.0"))


BALL = """schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.058
gap = 10e-3
turns = 1000
pole_area = 3e-4
support_damping = 0.3
control_rate = 1000.0
[gains]
kp = 155.0
ki = 15.5
kd = 2.61
td = 0.00226
ti = 0.226
[noise]
displacement = 1e-6
force = 2e-4
current = 1e-4
"""
COLUMNS = {"displacement": ("y_mm", 1e3), "force": ("F", 1.0), "command": ("u_mA", 1e3), "injection": ("r_mA", 1e3)}
COLUMNS |= {"current": ("i_mA", 1e3)}
SECONDS = 64
RESTING = """
[[recording]]
file = "{file}"
sample_rate = 1000.0
intersample = "zoh"
gains = {{ kp = 155.0, ki = 15.5, kd = 2.61, td = 0.00226, ti = 0.226 }}
excitation = {excitation}
[recording.channels]
"""


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A levitated ball driven by noise at the force, noise at the current, and a multisine; CSV in mm and mA."""
    folder = tmp_path_factory.mktemp("ball")
    (folder / "ball.toml").write_text(BALL)
    rig = rig_from_toml(BALL, "ball.toml")
    lines = tuple(range(1, SECONDS * 60))
    experiments = {
        "noise": (Excitation("multisine", "force", 1 / SECONDS, lines, 0.12, seed=9), 1, 0),
        "injected": (Excitation("multisine", "current", 1 / SECONDS, lines, 0.15, seed=8), 1, 0),
        "sine": (Excitation("multisine", "force", 0.5, tuple(range(4, 81)), 0.03, seed=4), 16, 1),
    }
    for seed, (name, (excitation, periods, transient)) in enumerate(experiments.items()):
        e = Experiment(rig, rig.gains, (excitation,), periods, transient, seed=seed)
        dataset = simulated_recording(e, simulate_records([e])[0])
        columns = {COLUMNS[str(n)][0]: COLUMNS[str(n)][1] * dataset[n].values for n in dataset.data_vars}
        write_csv(folder / f"{name}.csv", columns)
    return folder, Experiment(rig, rig.gains, (experiments["sine"][0],))


EXCITATIONS = {
    "noise": '{ kind = "recorded", at = "force", band = [2.0, 40.0] }',
    "injected": '{ kind = "recorded", at = "current", band = [2.0, 40.0] }',
    "sine": '{ kind = "multisine", fundamental = 0.5, harmonics = [4, 80], seed = 4, amplitude = 0.03, periods = 17 }',
}


def described(folder, name, channels):
    """Campaign and signals of one recording."""
    text = 'schema = "maglev-campaign/1"\nrig = "ball.toml"\n'
    text += RESTING.format(file=f"{name}.csv", excitation=EXCITATIONS[name])
    for channel in channels:
        column, factor = COLUMNS[channel]
        text += f'{channel} = {{ from = "{column}", scale = {1 / factor} }}\n'
    (folder / "campaign.toml").write_text(text)
    campaign = load_campaign(folder)
    (spec,) = campaign.recordings
    return campaign, recorded_signals(campaign, spec, read_recording(campaign, spec))


@pytest.fixture(scope="module")
def noise(ball):
    return described(ball[0], "noise", ("displacement", "force", "command"))


@pytest.fixture(scope="module")
def injected(ball):
    return described(ball[0], "injected", ("displacement", "command", "injection", "current"))


def only(signals, *names):
    return replace(signals, channels={name: signals.channels[name] for name in names})


@pytest.fixture(scope="module")
def both_ways(ball, noise):
    sine = described(ball[0], "sine", ("displacement", "force", "command"))
    return ball[1], *(identify(s, c.rig, c.mass, band_width=6.0, band_overlap=0.0) for c, s in (noise, sine))


def share_inside(difference, variance, freedom):
    """Real and imaginary parts inside their 95 % intervals."""
    limit = stats.t.ppf(0.975, freedom) * np.sqrt(variance / 2)
    return np.mean([np.abs(difference.real) < limit, np.abs(difference.imag) < limit])


@pytest.mark.slow
def test_responses_to_noise_and_to_a_multisine_agree_line_by_line(both_ways):
    e, noise, sine = both_ways
    assert noise.statistics.lines.size == 345 and sine.statistics.lines.size == 77
    assert noise.statistics.frequency.min() >= 2.0 and noise.statistics.frequency.max() <= 40.0
    (g, v), (g_sine, v_sine) = (frequency_response(f.statistics, "displacement", "force") for f in (noise, sine))
    # The receptance turns quickly, its inverse hardly. Between lines a spline is no noisier than at them.
    f = noise.statistics.frequency
    inner = (f >= sine.statistics.frequency[0]) & (f <= sine.statistics.frequency[-1])
    other = 1 / CubicSpline(sine.statistics.frequency, 1 / g_sine)(f[inner])
    scatter = np.interp(f[inner], sine.statistics.frequency, v_sine / np.abs(g_sine) ** 2) * np.abs(other) ** 2
    share = share_inside(g[inner] - other, v[inner] + scatter, 30)
    # 345 lines in windows of three that share one noise estimate, neighbours of a spline that share its noise: as 77.
    assert share > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 77)
    for found, response, variance, freedom in ((noise, g, v, 30), (sine, g_sine, v_sine, 32)):
        x = found.statistics.frequency / 1000
        exact = loop_response(e, 1000 * x).receptance / (np.sinc(x) * np.exp(-1j * np.pi * x))
        # The force law bends by a thousandth at a third of a millimetre.
        share = share_inside(response - exact, variance + 1e-6 * np.abs(exact) ** 2, freedom)
        assert abs(share - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / (len(x) / 3))
    assert np.sqrt(np.median(v[inner] / np.abs(g[inner]) ** 2)) < 0.02  # a scale or a hold forgotten would show


@pytest.mark.slow
def test_coefficients_and_margins_from_noise_agree_with_those_from_a_multisine(both_ways):
    e, *found = both_ways
    errors = []
    for one in found:
        bands = np.array([(b.f_lo, b.f_hi) for b in one.bands])
        assert len(bands) == 6
        x = one.statistics.frequency / 1000
        exact = loop_response(e, 1000 * x).receptance / (np.sinc(x) * np.exp(-1j * np.pi * x))
        w = 2000 * np.pi * x
        curves = {"stiffness": (1 / exact).real + e.rig.mass * w**2, "damping": (1 / exact).imag / w}
        within = [slice(*ends) for ends in band_slices(one.statistics.frequency, bands)]
        for name, curve in curves.items():
            truth = np.array([curve[lines].mean() for lines in within])
            value, se = (np.array([getattr(b, name + end) for b in one.bands]) for end in ("", "_se"))
            off = value - truth
            ends = np.array([getattr(b, f"{name}_ci") for b in one.bands])
            bent = 1e-3 * np.abs(truth)
            inside = (ends[:, 0] - bent < truth) & (truth < ends[:, 1] + bent)
            assert inside.sum() >= 5
            errors.append((off, np.hypot(se, bent)))
    for (a, a_se), (b, b_se) in zip(errors[:2], errors[2:], strict=True):
        assert np.sum(((a - b) / np.hypot(a_se, b_se)) ** 2) < stats.chi2.ppf(0.999, 6)
    peaks = [one.stability.margins.peak_sensitivity for one in found]
    exact = np.abs(loop_response(e, np.linspace(1.0, 60.0, 5000)).sensitivity).max()
    np.testing.assert_allclose(peaks, exact, rtol=0.02)
    for one, other in (found, found[::-1]):
        assert one.stability.source == "assumes the nominal actuator" and one.stability.iso_14839_3_zone == "A"
        low, high = one.stability.margins.intervals["phase_margin"]
        assert low - 0.5 < other.stability.margins.phase_margin < high + 0.5
    assert any("not periodic" in n and "local polynomials" in n for n in found[0].notes)
    assert not any("not periodic" in n for n in found[1].notes)
    assert found[0].distortion.even is found[0].distortion.odd is None and found[0].transient_periods == 0


def test_the_quality_of_a_recorded_excitation(noise):
    campaign, signals = noise
    q = recording_quality(signals, campaign.rig)
    assert q.can["stiffness and damping"] == "yes" and q.can["margins"].startswith("no")
    assert q.can["nonlinear distortion"] == "no: needs a periodic excitation with lines left out"
    assert q.leftover == q.transient_periods == 0
    (step,) = q.problems  # and not the crest factor, nor the number of periods
    assert step.startswith("command: one converter step is 7% of the rms")
    telegraph = np.where(np.arange(signals.channels["command"].size) % 64 < 32, 0.1, -0.1)
    told = replace(signals, channels={**signals.channels, "injection": telegraph})
    assert recording_quality(told, campaign.rig).problems == q.problems  # its two levels are no converter's
    assert all(b.verdict == "good" and b.coherence > 0.99 for b in q.bands) and len(q.bands) == 8
    assert 2.0 <= q.bands[0].f_lo < q.bands[-1].f_hi <= 40.0
    displacement = next(c for c in q.channels if c.name == "displacement")
    assert displacement.rms == pytest.approx(signals.channels["displacement"].std()) and displacement.snr_median > 50
    loud = signals.channels["displacement"]
    loud = loud + 5 * loud.std() * np.random.default_rng(0).standard_normal(loud.size)
    drowned = recording_quality(replace(signals, channels=signals.channels | {"displacement": loud}), campaign.rig)
    assert any("lost in noise" in p for p in drowned.problems)
    assert [b.verdict for b in drowned.bands][-1] == "noise rules"


@pytest.mark.slow
def test_a_band_of_a_recorded_excitation_bounds_its_lines(noise):
    campaign, signals = noise
    (excitation,) = signals.excitations
    assert excitation == Excitation("recorded", band=(2.0, 40.0))
    for low, high in ((2.0, 20.0), (15.0, 40.0)):
        part = replace(signals, excitations=(replace(excitation, band=(low, high)),))
        found = identify(part, campaign.rig, campaign.mass, band_width=6.0, band_overlap=0.0)
        assert low <= found.bands[0].f_lo < low + 0.5 and high - 6.5 < found.bands[-1].f_hi <= high
    for band, words in (((2.0, 600.0), r"band 2 .. 600 Hz.*0 .. 500 Hz"), ((2.0, 2.1), "widen the band")):
        with pytest.raises(ValueError, match=words):
            identify(replace(signals, excitations=(replace(excitation, band=band),)), campaign.rig, campaign.mass)


@pytest.mark.slow
def test_recorded_noise_at_the_current_tells_the_loop(ball, injected):
    (campaign, signals), e = injected, ball[1]
    assert recording_quality(signals, campaign.rig).can["margins"] == "yes"
    found = identify(signals, campaign.rig, campaign.mass, band_width=6.0, band_overlap=0.0)
    assert found.stability.source == "injection" and found.statistics.lines.size == 345
    s = found.stability
    exact = loop_response(e, s.frequency).sensitivity
    assert np.median(np.abs(s.sensitivity / exact - 1)) < 0.02
    peak = np.abs(loop_response(e, np.linspace(2.0, 40.0, 5000)).sensitivity).max()
    low, high = s.margins.intervals["peak_sensitivity"]
    assert 0.99 * low < peak < 1.01 * high and high / low < 1.05
    gain, stiffness = linearise(force_law(e.rig))
    assert found.actuator.gain == pytest.approx(gain, rel=0.01)
    band = found.bands[0]
    assert band.stiffness_ci[0] < stiffness < band.stiffness_ci[1]


def test_without_a_force_or_a_current_stiffness_is_asked_for_in_vain(ball, injected):
    campaign, signals = injected
    bare = only(signals, "displacement", "injection")
    silent = replace(bare, channels=bare.channels | {"force": 1e-4 * np.sin(np.arange(64_000.0))})
    for lacking in (bare, silent):
        with pytest.raises(ValueError, match=r"an excitation at the force.*or one at the current.*channel current"):
            identify(lacking, campaign.rig, campaign.mass)
        assert (
            recording_quality(lacking).can["stiffness and damping"].startswith("no response: needs displacement, and ")
        )
    with pytest.raises(ValueError, match="a known mass"):
        identify(signals, campaign.rig, None)
    with pytest.raises(ValueError, match="recorded at current needs the channel injection"):
        described(ball[0], "injected", ("displacement", "force"))


@pytest.mark.parametrize("drive", ["current", "command"])
def test_the_held_current_does_not_bias_the_damping(injected, drive):
    campaign, signals = injected
    if drive == "command":
        signals = only(signals, "displacement", "command", "injection")
    found = identify(signals, campaign.rig, campaign.mass, band_width=6.0, band_overlap=0.0)
    for band in found.bands:  # of the support: 0.3 N s/m; (k - m w^2) T / 2 is -0.09 to -1.4
        assert band.damping == pytest.approx(0.3, abs=4 * band.damping_se)


def test_a_current_alone_stands_for_the_force(injected):
    campaign, signals = injected
    bare = only(signals, "displacement", "injection", "current")
    assert identify(bare, campaign.rig, campaign.mass).actuator.gain == pytest.approx(1.46, rel=0.02)


def test_an_uncertain_actuator_gain_widens_the_intervals_by_what_it_moves():
    """The force of a magnet scales with its gain, and with it the whole of k - m w^2: far more than k alone, above."""
    rig = load_rig("hmb_free")
    e = Experiment(rig, rig.gains, (Excitation("sphs", "current", 5.0, tuple(range(4, 61)), 0.1),), 6, 2, seed=3)
    found = identify(only(recorded(e), "displacement", "current", "injection"), rig, rig.mass, False, 30.0, 0.0)
    layout = np.array([[b.f_lo, b.f_hi] for b in found.bands])
    force = found.statistics.channels.index("force")
    scale = np.ones(len(found.statistics.channels))
    scale[force] += found.actuator.gain_se / found.actuator.gain
    other = replace(
        found.statistics,
        mean=found.statistics.mean * scale[:, None],
        covariance=found.statistics.covariance * np.outer(scale, scale)[:, :, None],
    )
    alone, moved = (maximum_likelihood(s, layout, rig.mass) for s in (found.statistics, other))
    for i, band in enumerate(found.bands[:6]):  # 20 to 200 Hz; above, the gain is not what is uncertain
        mean, _ = band_mean(found.statistics, layout[i], rig.mass, (alone.stiffness[i], alone.damping[i]))
        expected = np.hypot(mean.se, moved.stiffness[i] - alone.stiffness[i])
        assert band.stiffness_se == pytest.approx(expected, rel=0.1)
        reach = np.hypot(mean.value - mean.low, 1.96 * (moved.stiffness[i] - alone.stiffness[i]))
        assert band.stiffness - band.stiffness_ci[0] == pytest.approx(reach, rel=0.1)
        assert reach > 1.1 * (alone.stiffness[i] - alone.stiffness_low[i])


@pytest.mark.slow
@pytest.mark.parametrize("channels", [("current",), ()])
def test_a_record_of_the_injection_alone_gives_gain_stiffness_damping_and_margins(channels):
    """The rig has no damping: the lags of probe and amplifier and the current between its readings must leave none."""
    rig = load_rig("hmb_free")
    gain, stiffness = linearise(force_law(rig))
    names = ("displacement", "injection", "command", *channels)
    first = protocol_experiment(rig, rig.gains)
    injected = tuple(e for e in first.excitations if e.at == "current")
    z = []
    for seed in range(8):
        e = replace(first, seed=seed, excitations=injected)
        found = identify(only(recorded(e, held=False), *names), rig, rig.mass)
        a = found.actuator
        z.append([(a.gain - gain) / a.gain_se, (a.stiffness - stiffness) / a.stiffness_se, a.damping / a.damping_se])
        assert found.stability.source == "injection" and found.stability.margins.gain_margin_high > 10
    assert (np.abs(np.mean(z, axis=0)) < 3 / np.sqrt(len(z))).all()  # without the chain the damping is off by 4 to 20


def test_margins_by_the_nominal_actuator_hold_within_its_tolerance():
    """A rig whose gain is 2 sigma above the nominal one: the interval of the noise alone excludes its peak of |S|."""
    rig = load_rig("hmb_free")
    true = with_parameters(rig, {"actuator_gain": rig.actuator_gain * (1 + 1.5 * rig.tolerance["actuator_gain"])})
    first = protocol_experiment(true, rig.gains)
    e = replace(first, excitations=tuple(x for x in first.excitations if x.at == "force"), seed=5)
    signals = only(recorded(e), "displacement", "force")
    found, sure = (identify(signals, one, rig.mass).stability for one in (rig, replace(rig, tolerance={})))
    f = np.linspace(20.0, 250.0, 4000)
    peak = np.abs(loop_response(e, f).sensitivity).max()
    assert "tolerance" not in str(sure) and found.source == sure.source == "assumes the nominal actuator"
    low, high = found.margins.intervals["peak_sensitivity"]
    assert low < peak < high
    low, high = sure.margins.intervals["peak_sensitivity"]
    assert not low < peak < high


def test_magnets_described_by_their_geometry_have_a_tolerance_too():
    """A preset without numbers for gain and negative stiffness has the margins of one that states its law's."""
    rig = load_rig("eframe")
    assert rig.actuator_gain is None and "actuator_gain" in rig.tolerance
    gain, pull = linearise(force_law(rig))
    stated = with_parameters(rig, {"actuator_gain": gain, "negative_stiffness": float(pull)})
    signals = only(recorded(replace(protocol_experiment(rig, rig.gains), seed=5)), "displacement", "force")
    one, other = (identify(signals, r, rig.mass).stability.margins for r in (rig, stated))
    assert one.intervals["peak_sensitivity"] == pytest.approx(other.intervals["peak_sensitivity"], rel=1e-6)
