"""An x-y rig with magnets from simulation through files to its coefficients, margins and checks, axis by axis."""

import json
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from command_line import maglev
from scipy import stats

from estimation.bands import band_slices
from estimation.lines.periods import held, multiplied
from estimation.xy.planar import axis_statistics, eight_coefficients
from maglev_env.design.protocols import sphs_campaign
from maglev_env.evaluation.identification import identify
from maglev_env.evaluation.identification_planar import identify_planar
from maglev_env.experiment import Experiment, axis_experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import NO_CONTROLLER, Gains, controller_response
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.quality import recording_quality
from maglev_env.recordings.recording import read_recording, simulated_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig, rig_from_toml

PRESET = (resources.files("maglev_env") / "rigs" / "hmb_radial.toml").read_text()
# Axes that cannot be mistaken for one another: springs, damping and controllers of their own.
OWN = """[axis.y]
support_stiffness = 130e3
support_damping = 15.0

[gains.x]
kp = 8000.0
ki = 2000.0
kd = 5.2
[gains.y]
kp = 7500.0
ki = 2000.0
kd = 6.5

"""
UNLIKE = PRESET[: PRESET.index("[gains]")] + OWN + PRESET[PRESET.index("[noise]") :]


def simulated(e):
    return simulated_recording(e, simulate_records([e])[0])


def written(folder, source, experiments):
    recordings = [(f"run{i}", "fit", simulated(e), e) for i, e in enumerate(experiments, 1)]
    return load_campaign(write_campaign(folder, source, {}, recordings))


def read(campaign):
    return [recorded_signals(campaign, spec, read_recording(campaign, spec)) for spec in campaign.recordings]


@pytest.fixture(scope="module")
def unlike(tmp_path_factory):
    """The campaign of a rig with unlike axes, its experiments at 45 and 135 degrees, and its recordings."""
    folder = tmp_path_factory.mktemp("unlike")
    (folder / "mine.toml").write_text(UNLIKE)
    rig = load_rig(folder / "mine.toml")
    experiments = [plan.experiment for plan in sphs_campaign(rig, rig.gains, {}, 2)]
    campaign = written(folder / "campaign", str(folder / "mine.toml"), experiments)
    return campaign, experiments, read(campaign)


def inside(hits):
    """The share of hits is compatible with 95 % of independent intervals (chance 1e-4)."""
    return np.sum(hits) >= stats.binom.ppf(1e-4, np.size(hits), 0.95)


def test_the_files_hold_the_rig_the_gains_and_the_directions(unlike):
    campaign, experiments, signals = unlike
    assert campaign.rig.per_axis == {"y": {"support_stiffness": 130e3, "support_damping": 15.0}}
    for spec, e, own, turn in zip(campaign.recordings, experiments, signals, (45.0, 135.0), strict=True):
        assert spec.gains == own.gains == (Gains(8000.0, 2000.0, 5.2), Gains(7500.0, 2000.0, 6.5))
        assert spec.excitations == own.excitations == e.excitations and spec.excitations[0].direction == turn
        assert own.axes == 2 and own.hold_rate == 20_000.0 and own.assumed == ()


@pytest.mark.parametrize("axis", [0, 1])
def test_each_axis_has_the_direct_coefficients_of_its_linear_loop(unlike, axis):
    """D eq 5.10-5.12: without cross-coupling those of the axis, whatever the direction of the force."""
    campaign, experiments, signals = unlike
    k_hits, c_hits = [], []
    for e, both in zip(experiments, signals, strict=True):
        found = identify(axis_signals(both, axis), axis_rig(campaign.rig, axis), campaign.mass, band_overlap=0.0)
        bands = np.array([(b.f_lo, b.f_hi) for b in found.bands])
        exact = axis_statistics(expected_statistics(e, lines_at(e.excitations, "force")), "xy"[axis])
        exact = held(exact, "force", 20_000.0)
        z = exact.amplitude("force") / (exact.amplitude("displacement") * unlagged(exact.frequency))
        w = 2 * np.pi * exact.frequency
        lines = [slice(*ends) for ends in band_slices(exact.frequency, bands)]
        stiffness, damping = (
            [curve[within].mean() for within in lines] for curve in (z.real + campaign.mass * w**2, z.imag / w)
        )
        assert len(bands) == 16
        for b, k, c in zip(found.bands, stiffness, damping, strict=True):
            # The force law bends by some tenths of a percent at this amplitude.
            k_hits.append(b.stiffness_ci[0] - 2e-4 * k < k < b.stiffness_ci[1] + 2e-4 * k)
            c_hits.append(b.damping_ci[0] < c < b.damping_ci[1])
        middle = found.bands[4]
        assert middle.stiffness == pytest.approx((169e3, 160.5e3)[axis], rel=0.02)
        assert middle.damping == pytest.approx(damping[4], rel=0.01)
    assert inside(k_hits) and inside(c_hits)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1])
def test_each_axis_has_the_margins_and_the_promise_of_its_own_controller(unlike, axis):
    campaign, experiments, signals = unlike
    f = np.linspace(5.0, 2000.0, 20_000)
    loop = loop_response(axis_experiment(experiments[0], axis), f)
    peak = np.abs(loop.sensitivity).max()
    for both in signals:
        found = identify(axis_signals(both, axis), axis_rig(campaign.rig, axis), campaign.mass)
        assert found.stability.source == "injection"
        low, high = found.stability.margins.intervals["peak_sensitivity"]
        assert 0.98 * low < peak < 1.02 * high and high / low < 1.1
        band = found.bands[20]
        z = np.exp(2j * np.pi * np.array([(band.f_lo + band.f_hi) / 2]) / 20_000)
        promised = 5.7 * controller_response(experiments[0].gains[axis], z, 1 / 20_000)[0]
        support = (134.5e3, 130e3)[axis], (10.0, 15.0)[axis]
        assert band.effective_stiffness == pytest.approx(promised.real - 12.5e3 + support[0])
        w = np.pi * (band.f_lo + band.f_hi)
        assert band.effective_damping == pytest.approx(promised.imag / w + support[1])


def test_together_they_tell_eight_coefficients_of_which_four_are_nothing(unlike):
    campaign, experiments, signals = unlike
    found = identify_planar(signals, campaign.rig, campaign.mass, band_overlap=0.0)
    e = found.estimate
    assert e.identifiable.all() and found.notes == ()
    expected = [
        held(held(expected_statistics(x, lines_at(x.excitations, "force")), "force_x", 2e4), "force_y", 2e4)
        for x in experiments
    ]
    for name in ("displacement_x", "displacement_y"):
        expected = [multiplied(one, name, unlagged(one.frequency)) for one in expected]
    exact = eight_coefficients(expected, found.bands, campaign.mass, intervals=False)
    bent = 2e-4 * 169e3  # of the force law
    hits = (e.stiffness_low - bent < exact.stiffness) & (exact.stiffness < e.stiffness_high + bent)
    assert inside(hits) and inside((e.damping_low < exact.damping) & (exact.damping < e.damping_high))
    across = exact.stiffness[:, [0, 1], [1, 0]]
    assert np.abs(across).max() < 1.0  # N/m, of 169 kN/m: nothing couples the axes
    np.testing.assert_allclose(e.stiffness - found.bearing_stiffness, np.full((16, 2, 2), np.diag([134.5e3, 130e3])))
    np.testing.assert_allclose(e.damping - found.bearing_damping, np.full((16, 2, 2), np.diag([10.0, 15.0])))
    assert found.bearing_stiffness[4, 0, 0] == pytest.approx(34.5e3, rel=0.02)


def unlagged(frequency):
    """What takes the lag of the nominal probe out of a displacement."""
    return 1 + 2j * np.pi * frequency * load_rig("hmb_radial").sensor_time_constant


def test_one_direction_of_like_axes_tells_row_sums_only():
    rig = load_rig("hmb_radial")
    e = protocol_experiment(rig, seed=3)
    both = _signals(e, simulated(e))
    found = identify_planar([both], rig, rig.mass, band_overlap=0.0)
    assert not found.estimate.identifiable.any() and np.isnan(found.estimate.damping).all()
    assert "no band" in found.notes[0]
    x, y = found.row_sums[0].x, found.row_sums[0].y
    for axis, sums in enumerate((x, y)):
        own = identify(axis_signals(both, axis), axis_rig(rig, axis), rig.mass, band_overlap=0.0)
        # One gives constants, the other means over the band.
        for name in ("stiffness", "damping"):
            mean, se = (np.array([getattr(b, name + end) for b in own.bands]) for end in ("", "_se"))
            assert np.median(np.abs(getattr(sums, name) - mean) / se) < 1.0


def _signals(e, dataset):
    channels = {str(n): dataset[n].values for n in dataset.data_vars}
    return RecordedSignals(channels, e.recorded_rate, e.excitations, e.rig.control_rate, e.gains, axes=e.rig.axes)


def test_the_quality_of_each_axis_is_that_of_its_channels(unlike):
    campaign, _, signals = unlike
    for axis, name in enumerate("xy"):
        own = recording_quality(axis_signals(signals[0], axis), axis_rig(campaign.rig, axis))
        assert own.can["stiffness and damping"] == own.can["margins"] == own.can["amplifier block"] == "yes"
        assert own.can["nonlinear distortion"] == "no: every line is excited"
        assert own.periods == 5 and own.transient_periods == 1 and not own.problems
        assert [b.verdict for b in own.bands] == ["good"] * 7 + ["usable"] and own.bands[-1].f_hi == 249.0
        channels = {c.name: c for c in own.channels}
        assert set(channels) == {"displacement", "command", "current", "force", "injection"}
        values = signals[0].channels[f"displacement_{name}"]
        assert channels["displacement"].rms == pytest.approx(values.std())
        assert channels["force"].snr_worst > 30
        # Forty times the signal leaves the clearance, in this axis alone.
        huge = signals[0].channels | {f"displacement_{name}": 40 * values}
        far = [
            recording_quality(axis_signals(replace(signals[0], channels=huge), a), axis_rig(campaign.rig, a)).problems
            for a in range(2)
        ]
        assert any("clearance" in p for p in far[axis]) and not far[1 - axis]


# A small rig without magnets: what the commands make of campaigns of every make-up.
CROSSED = """schema = "maglev-rig/1"
name = "crossed"
magnet = "none"
axes = 2
[parameters]
mass = 0.8
support_stiffness = 1.2e5
support_damping = 12.0
gap = 1e-3
control_rate = 4000.0
[axis.y]
mass = 1.0
support_stiffness = 0.9e5
[cross]
stiffness_xy = 1e-3
[noise]
displacement = 0.5e-6
force = 5e-3
[protocol]
band_width = 12.0
band_overlap = 0.0
[[protocol.excitation]]
kind = "sphs"
harmonics = [5, 120]
amplitude = 3.0
direction = 30.0
"""


def crossed(folder, *directions, **noise):
    (folder / "rig.toml").write_text(CROSSED)
    rig = rig_from_toml(CROSSED, "rig.toml")
    rig = replace(rig, noise=replace(rig.noise, **noise))
    e = protocol_experiment(rig, seed=1)
    turned = [replace(e, excitations=(replace(e.excitations[0], direction=d),)) for d in directions]
    return written(folder / "campaign", str(folder / "rig.toml"), turned)


def estimated(campaign, folder):
    return by_command("estimate", campaign, folder, "--method", "ml")


def by_command(name, campaign, folder, *options):
    """What a command writes as JSON of a campaign."""
    files = ["--out", folder / "page.html", "--json", folder / "found.json"]
    maglev(name, campaign.folder, *options, *files)
    return json.loads((folder / "found.json").read_text())


@pytest.mark.slow
def test_the_command_joins_the_directions(tmp_path):
    found = estimated(crossed(tmp_path, 30.0, 120.0), tmp_path)
    assert [r["file"] for r in found["recordings"]] == ["run1.npz, x", "run1.npz, y", "run2.npz, x", "run2.npz, y"]
    assert len(found["planar"]) == 1 and (tmp_path / "page.html").stat().st_size > 10_000


def test_the_command_gives_each_axis_its_own_mass(tmp_path):
    found = estimated(crossed(tmp_path, 30.0), tmp_path)
    for recording, stiffness in zip(found["recordings"], (1.2e5, 0.9e5), strict=True):
        for band in recording["bands"]:
            assert band["stiffness"] == pytest.approx(stiffness, abs=5 * band["stiffness_se"])


def test_the_command_checks_a_recording_driven_along_one_axis(tmp_path):
    campaign = crossed(tmp_path, 0.0)
    assert by_command("check", campaign, tmp_path)["recordings"]


def test_the_command_estimates_the_axis_that_is_driven(tmp_path):
    found = estimated(crossed(tmp_path, 0.0), tmp_path)
    assert [r["file"] for r in found["recordings"]] == ["run1.npz, x"]


def test_nothing_pushes_across_the_direction(tmp_path):
    campaign = crossed(tmp_path, 0.0, force=0.0)
    assert not read_recording(campaign, campaign.recordings[0])["force_y"].values.any()


def test_a_force_in_another_direction_is_no_excitation(tmp_path):
    campaign = crossed(tmp_path, 30.0)
    (spec,) = campaign.recordings
    for direction in (30.0, 210.0, 390.0, 60.0):
        stated = replace(spec, excitations=(replace(spec.excitations[0], direction=direction),))
        read_recording(campaign, stated)
    for direction in (120.0, -60.0):
        stated = replace(spec, excitations=(replace(spec.excitations[0], direction=direction),))
        with pytest.raises(ValueError, match=r"run1\.npz: channel 'force': no excitation at line 5 \(5 Hz\), 6.* at 1"):
            read_recording(campaign, stated)


def test_a_force_in_another_direction_is_no_excitation_without_noise_either(tmp_path):
    campaign = crossed(tmp_path, 30.0, force=0.0)
    (spec,) = campaign.recordings
    read_recording(campaign, spec)
    with pytest.raises(ValueError, match="no excitation at line"):
        read_recording(campaign, replace(spec, excitations=(replace(spec.excitations[0], direction=120.0),)))


def test_a_force_of_one_channel_is_that_channel(tmp_path):
    campaign = crossed(tmp_path, 0.0)
    (spec,) = campaign.recordings
    kept = {name: source for name, source in spec.channels.items() if name != "force_y"}
    dataset = read_recording(campaign, replace(spec, channels=kept))
    signals = recorded_signals(campaign, spec, dataset)
    k = [b.stiffness for b in identify(axis_signals(signals, 0), axis_rig(campaign.rig, 0), 0.8).bands]
    assert k[4] == pytest.approx(1.2e5, rel=1e-3)
    kept["force_x"] = spec.channels["force_y"]
    with pytest.raises(ValueError, match="channel 'force_x': no excitation"):
        read_recording(campaign, replace(spec, channels=kept))


RADIAL_ONE = ["displacement", "force", "command", "injection", "current"]


@pytest.fixture(scope="module")
def along_x():
    """hmb_radial driven along x: the force and the injections along x, so that x is known by itself."""
    rig = load_rig("hmb_radial")
    e = protocol_experiment(rig, seed=4)
    parts = tuple(replace(part, direction=0.0) for part in e.excitations)
    e = replace(e, excitations=parts)
    return e, simulated(e)


def test_one_axis_of_an_x_y_recording_works_without_its_rig_as_one_axis(tmp_path, along_x):
    e, dataset = along_x
    one = dataset[[f"{name}_x" for name in RADIAL_ONE]]
    write_campaign(tmp_path, "hmb_free", {}, [("a", "fit", one, e)])
    campaign = load_campaign(tmp_path)
    (signals,) = read(campaign)
    assert signals.axes == 1 and set(signals.channels) == set(RADIAL_ONE)
    whole = identify(signals, axis_rig(e.rig, 0), 0.92)
    both = _signals(e, dataset)
    np.testing.assert_allclose(
        [b.stiffness for b in whole.bands],
        [b.stiffness for b in identify(axis_signals(both, 0), axis_rig(e.rig, 0), 0.92).bands],
        rtol=1e-9,
    )
    assert whole.stability.source == "injection"


@pytest.mark.parametrize("pair", [False, True])
def test_one_axis_of_an_x_y_rig_is_identified_with_the_rig_of_that_axis(tmp_path, along_x, pair):
    e, dataset = along_x
    one = dataset[[f"{name}_x" for name in RADIAL_ONE]]
    gains = (e.gains, Gains(1.0, 1.0, 1.0)) if pair else e.gains
    write_campaign(tmp_path / "c", "hmb_radial", {}, [("a", "fit", one, replace(e, gains=gains))])
    campaign = load_campaign(tmp_path / "c")
    found = estimated(campaign, tmp_path)
    assert found["recordings"][0]["bands"][20]["stiffness"] == pytest.approx(168.6e3, rel=0.02)
    (signals,) = read(campaign)
    by_itself = identify(signals, axis_rig(campaign.rig, signals.axis), 0.92)
    assert signals.axis == 0 and by_itself.bands[20].effective_stiffness == pytest.approx(168.6e3, rel=0.02)


def test_a_force_along_x_and_injections_in_both_axes_tell_x(tmp_path):
    rig = load_rig("hmb_radial")
    e = protocol_experiment(rig, seed=4)
    e = replace(e, excitations=(replace(e.excitations[0], direction=0.0), *e.excitations[1:]))
    found = estimated(written(tmp_path / "c", "hmb_radial", [e]), tmp_path)
    assert "run1.npz, x" in [r["file"] for r in found["recordings"]]


def test_an_experiment_without_direction_pushes_along_x():
    rig = load_rig("hmb_radial")
    e = Experiment(rig, NO_CONTROLLER, (Excitation("sphs", "force", 10.0, (1, 2), 1.0),))
    wave = e.waveform("force")
    assert wave.shape == (2, 2000) and not wave[1].any() and np.abs(wave[0]).max() == pytest.approx(1.0)
