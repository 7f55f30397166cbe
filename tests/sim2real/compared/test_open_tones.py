"""Tones in recordings without a period, of another bench: found, measured, taken out, and not seen in noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from campaigns import campaign

from estimation.lines.line_windows import KEPT
from estimation.lines.tones import Tone
from sim2real.compared import open_tones
from sim2real.compared.distortion import distorted, driving_sines, pattern_rate
from sim2real.compared.open_tones import (
    _as_told_better,
    agreed,
    frequency_sd,
    nuisance_columns,
    toned,
    with_tones,
    without_tones_of_others,
)
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.compared.tones_left import (
    Residual,
    lines_of,
    log_chances,
    residual_of,
    stands_out,
    strongest_near,
    taken_out,
    tones_in,
)
from sim2real.judgement.tones.sightings import FOREIGN, _between
from sim2real.recorded.records import read_records
from sim2real.recorded.tones import tone_lines

TONE = 2e-7  # m: a fifth of the noise of one sample


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    def made(bench, kind, seed=0):
        _, (record,) = read_records(write_campaign(tmp_path_factory.mktemp(kind), bench, {kind: "fit"}, 1.0, seed))
        return record

    return made


@pytest.mark.parametrize("kind", ["noise", "steps"])
@pytest.mark.parametrize("frequency", [61.7, 240.0])
def test_a_tone_is_found_and_measured_beside_a_gap(read, kind, frequency):
    record = read(Bench(delay=20e-6, tone=TONE, tone_frequency=frequency), kind)
    (tone,) = with_tones(record).tones
    assert tone.frequency == pytest.approx(frequency, abs=0.1)
    assert abs(tone.amplitude["opened"][0]) == pytest.approx(TONE, rel=0.2)  # 1e-8 m is its standard deviation


@pytest.mark.slow
@pytest.mark.parametrize("bench", [Bench(), Bench(stiffness=-0.2), Bench(gain=0.2, delay=50e-6)])
@pytest.mark.parametrize("kind", ["noise", "steps", "chirp"])
def test_neither_noise_nor_a_gap_shows_a_tone(read, bench, kind):
    assert with_tones(read(bench, kind)).tones == ()


def test_noise_shows_a_tone_as_often_as_stated(read):
    residual = residual_of(read(Bench(), "noise"), Point({}, {}))
    rng, chances = np.random.default_rng(1), []
    for _ in range(400):
        noise = rng.normal(size=(2, *residual.lines.shape))
        chances.append(np.exp(log_chances(replace(residual, lines=noise[0] + 1j * noise[1]), np.array([161.3]))[0]))
    for level in (0.02, 0.1, 0.5):
        assert np.mean(np.array(chances) < level) == pytest.approx(level, abs=3.5 * np.sqrt(level * (1 - level) / 400))


def test_a_tone_that_a_better_point_does_not_leave_is_not_seen(read):
    """What friction does after steps looked like a foreign vibration, because a point without it had left it."""
    shaken, sound, point = read(Bench(tone=TONE, tone_frequency=61.7), "noise"), read(Bench(), "noise"), Point({}, {})
    (tone,) = with_tones(shaken).tones
    for record, seen in ((shaken, True), (sound, False)):
        assert stands_out(residual_of(record, point), tone.frequency) == seen
        part = SimpleNamespace(record=replace(record, tones=(tone,)))
        assert bool(_between(0, part, point)) == seen


@pytest.mark.slow
def test_a_tone_that_was_found_leaves_the_fit_alone(read):
    found = with_tones(read(Bench(tone=10 * TONE), "noise"))
    problem = assemble([found])
    power = abs(problem.data - problem.simulate([Point({}, {})])[0]) ** 2 / 2
    near = abs(problem.frequency - 61.7) < 12.0
    assert near.sum() > 10 and power[near].mean() == pytest.approx(1.0, abs=5 / np.sqrt(near.sum()))
    assert tones_in(residual_of(found, Point({}, {})), np.array([61.7]))[1] > 1e4  # as it was recorded


def test_a_tone_of_unknown_origin_counts_where_two_recordings_have_it(read):
    one = replace(
        read(Bench(), "noise"), tones=tuple(Tone(f, {"opened": np.ones(1)}, 99.0) for f in (61.7, 50.1, 83.0))
    )
    other = replace(one, tones=(Tone(61.75, {"opened": np.ones(1)}, 99.0), Tone(83.4, {"opened": np.ones(1)}, 99.0)))
    assert [[t.frequency for t in r.tones] for r in agreed([one, other])] == [[61.7, 50.1], [61.75]]


def test_a_harmonic_of_the_mains_counts_in_the_one_recording_that_shows_it(read):
    """A distorted mains has a fifth harmonic, which a recording of another band does not show."""
    loud, silent = Tone(49.9, {"opened": np.ones(1)}, 1e5), read(Bench(), "noise")
    for frequency, shown, counts in ((249.5, loud, True), (251.9, loud, False), (249.5, None, False)):
        fifth = Tone(frequency, {"opened": np.ones(1)}, 99.0)
        one = replace(silent, tones=(fifth,))
        other = silent if shown is None else replace(silent, tones=(shown,))
        assert [len(r.tones) for r in agreed([one, other])] == [int(counts), len(other.tones)]


@pytest.mark.parametrize(("chi2", "both"), [(40.0, True), (400.0, False)])
def test_two_faint_tones_may_be_one_where_two_loud_ones_are_not(read, chi2, both):
    """A fifth of a line apart, which of a faint one is hardly more than the scatter of its frequency."""
    one = replace(read(Bench(), "noise"), tones=(Tone(61.7, {"opened": np.ones(1)}, chi2),))
    spacing = one.windows.sample_rate / one.windows.samples
    other = replace(one, tones=(Tone(61.7 + 0.2 * spacing, {"opened": np.ones(1)}, chi2),))
    assert [len(r.tones) for r in agreed([one, other])] == ([1, 1] if both else [0, 0])


@pytest.mark.parametrize("level", [2.0, 30.0])
def test_the_frequency_of_a_tone_scatters_as_stated(read, level):
    residual = residual_of(read(Bench(), "noise"), Point({}, {}))
    record, rng, off = residual.record, np.random.default_rng(3), []
    at = 161.3 * record.windows.samples / record.windows.sample_rate
    for phase in rng.uniform(0, 2 * np.pi, 150):
        tone = Tone(161.3, {"opened": level * np.exp(1j * phase) * np.ones(1)}, 1.0)
        lines = lines_of(residual, tone)
        noise = rng.normal(size=(2, *lines.shape)) * abs(lines).max() / 10
        noisy = replace(residual, lines=lines + noise[0] + 1j * noise[1])
        found, _ = taken_out(noisy, strongest_near(noisy, at, 0.5))
        off.append((found.frequency - 161.3) / frequency_sd(record, found))
    assert 0.6 < np.std(off) < 1.5


def test_a_line_on_which_another_recording_shows_a_tone_is_not_compared(read, tmp_path):
    periodic = read_records(campaign(tmp_path / "c", names=("base", "holdout")))[1][0]
    at = float(periodic.frequency[~periodic.masked][20])
    for off, more in ((0.05, 1), (0.2, 0)):
        near = at + off * periodic.experiment.fundamental
        shows = replace(read(Bench(), "noise"), tones=(Tone(near, {"opened": np.ones(1)}, 99.0),))
        masked = without_tones_of_others([periodic, shows])[0].masked
        assert masked.sum() == periodic.masked.sum() + more
    mains = replace(shows, tones=(Tone(50.0, {"opened": np.ones(1)}, 99.0),))
    assert without_tones_of_others([periodic, mains])[0].elsewhere == ()


@pytest.fixture(scope="module")
def read_both(tmp_path_factory):
    def made(bench, seed=0, drift=0.0):
        folder = write_campaign(tmp_path_factory.mktemp("both"), bench, {"noise": "fit", "chirp": "fit"}, 1.0, seed)
        if drift:  # of the probe, as it warms up
            for kind in ("noise", "chirp"):
                channels = dict(np.load(folder / f"{kind}.npz"))
                n = len(channels["displacement"])
                channels["displacement"] += drift * (1 - np.exp(-np.arange(n) / n / 0.2))
                np.savez(folder / f"{kind}.npz", **channels)
        return read_records(folder)[1]

    return made


def test_a_slow_tone_counts_where_two_recordings_have_it(read_both):
    """Of 12.4 turns a record, in the first window, where a drift may be."""
    for record in toned(read_both(Bench(gain=0.1, tone=5 * TONE, tone_frequency=12.4))):
        (tone,) = record.tones
        assert tone.frequency == pytest.approx(12.4, abs=0.05)
        assert abs(tone.amplitude["opened"][0]) == pytest.approx(5 * TONE, rel=0.2)


def test_a_drift_and_a_slow_tone_that_one_recording_alone_has_do_not_count(read_both):
    assert [r.tones for r in toned(read_both(Bench(), drift=100 * TONE))] == [(), ()]
    noise, _ = read_both(Bench(tone=5 * TONE, tone_frequency=12.4))
    _, chirp = read_both(Bench())
    assert [r.tones for r in toned([noise, chirp])] == [(), ()]


def test_where_one_recording_shows_a_tone_others_are_looked_at_again(read_both):
    """Among all frequencies, noise hides the tone in one of both; at the frequency of the other it stands out."""
    noise, chirp = read_both(Bench(tone=0.5 * TONE))
    assert with_tones(chirp).tones and not with_tones(noise).tones
    assert [t.frequency for r in toned([noise, chirp]) for t in r.tones] == pytest.approx([61.7, 61.7], abs=0.3)


def test_where_one_recording_shows_the_rotation_others_are_looked_at_at_their_own_speed(read_both):
    """The same unbalance at 3702 and at 2470 rpm: noise hides the slower one among all frequencies."""

    def at(record, rpm):
        return replace(record, experiment=replace(record.experiment, speed_rpm=rpm))

    noise, _ = read_both(Bench(tone=0.5 * TONE, tone_frequency=41.1))
    _, chirp = read_both(Bench(tone=0.5 * TONE))
    assert with_tones(chirp).tones and not with_tones(noise).tones
    seen = [t.frequency for r in toned([at(noise, 2470.0), at(chirp, 3702.0)]) for t in r.tones]
    assert seen == pytest.approx([41.1, 61.7], abs=0.3)
    # At rest, or at the same speed, there is nothing else to look for.
    assert [len(r.tones) for r in toned([at(noise, 0.0), at(chirp, 3702.0)])] == [0, 1]
    assert [len(r.tones) for r in toned([at(noise, 3702.0), at(chirp, 3702.0)])] == [0, 1]


def test_drives_that_explain_most_of_a_window_leave_the_frequency_alone(read, monkeypatch):
    """The drives of two axes may explain most directions of every window. A gap that moves the tone in the others by a
    fifth of a line moves it less in all of them."""
    record, found = read(Bench(), "noise"), []
    w = record.windows
    at, elsewhere = (w.project(tone_lines(w, f)[0]) for f in (61.7, 61.9))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        shape, noise = (w.count, KEPT, 10), rng.normal(size=(2, 1, w.count, KEPT))
        driven = np.linalg.qr(rng.normal(size=shape) + 1j * rng.normal(size=shape))[0]
        beyond = (elsewhere - at) - np.einsum("wkd,wjd,wj->wk", driven, np.conj(driven), elsewhere - at)
        lines = (at + beyond)[None] + 0.03 * np.linalg.norm(at) * (noise[0] + 1j * noise[1])
        moved = Residual(record, lines, driven, np.full(w.count, 10), record.experiment)
        monkeypatch.setattr(open_tones, "residual_of", lambda record, near, moved=moved: moved)
        found.append(with_tones(record).tones[0].frequency)
    assert np.median(found) == pytest.approx(61.7, abs=0.15)


def test_what_a_loop_makes_of_a_sine_is_no_tone_and_what_it_does_not_make_is(read):
    """A dead band answers to 20 Hz at 60, 100, 140 ... Hz; the tone at 90 Hz is another one."""
    record = read(Bench(band=5e-3, tone=10 * TONE, tone_frequency=90.0), "sine")
    assert driving_sines(record) == pytest.approx([20.0], abs=0.2)
    (tone,) = with_tones(record).tones
    assert tone.frequency == pytest.approx(90.0, abs=0.1)


def test_products_of_two_sines_are_known_and_noise_and_a_chirp_have_none(read):
    record = read(Bench(), "sine")
    t = np.arange(record.waves["current"].shape[1]) / record.experiment.rig.control_rate
    two = replace(
        record, waves={**record.waves, "current": np.array([np.sin(2 * np.pi * 20 * t) + np.sin(2 * np.pi * 33 * t)])}
    )
    assert sorted(driving_sines(two)) == pytest.approx([20.0, 33.0], abs=0.2)
    at = np.array([7.0, 46.0, 53.0, 60.0, 73.0, 86.0, 25.0, 120.0])
    assert distorted(two, at, 3).tolist() == [True] * 6 + [False] * 2
    for kind in ("noise", "chirp", "steps", "hover"):
        other = read(Bench(), kind)
        assert driving_sines(other).size == 0 and not distorted(other, at).any()


def test_steps_that_go_round_answer_at_multiples_of_their_rate(read):
    """A bent force law answers to steps of both signs at twice the rate at which they repeat."""
    record = read(Bench(), "steps")
    rate, samples = record.experiment.rig.control_rate, record.waves["current"].shape[1]
    turn, rng = samples // 5, np.random.default_rng(0)
    steps = np.resize(np.repeat([0.0, 1.0, 0.0, -1.0, 1.5, -1.5], turn // 6 + 1)[:turn], samples)
    noisy = (steps + 0.05 * rng.normal(size=samples))[None]
    going_round = replace(record, waves={**record.waves, "current": noisy})
    assert pattern_rate(going_round) == pytest.approx(rate / turn, rel=1e-3)
    at = np.array([1.0, 2.0, 5.0, 2.5, 40.0]) * rate / turn
    assert distorted(going_round, at).tolist() == [True, True, True, False, False]
    for kind in ("noise", "chirp", "hover"):
        assert pattern_rate(read(Bench(), kind)) is None


@pytest.mark.parametrize(("chi2", "moved"), [(1e9, True), (1.0, False)])
def test_the_record_that_tells_a_frequency_best_tells_it_for_all(read, chi2, moved):
    """A loud tone that is taken out a twentieth of a line beside its frequency leaves much of itself."""
    record = read(Bench(tone=10 * TONE), "noise")
    (tone,) = with_tones(record).tones
    spacing = record.windows.sample_rate / record.windows.samples
    beside, left = taken_out(residual_of(record, Point({}, {})), tone.frequency / spacing + 0.05)
    one = replace(record, tones=(beside,))
    other = replace(record, tones=(replace(tone, chi2=chi2),))
    found, cleared = _as_told_better(one, left, [one, other])
    assert found.tones[0].frequency == pytest.approx(tone.frequency if moved else beside.frequency, rel=1e-12)
    window = abs(record.windows.centre - tone.frequency).argmin()
    before, after = (np.sum(abs(r.lines[:, window]) ** 2) for r in (left, cleared))
    assert after < 0.8 * before if moved else after == pytest.approx(before)


@pytest.mark.parametrize(("frequency", "family"), [(60.3, FOREIGN), (60.05, "pickup 60 Hz"), (49.9, "pickup 50 Hz")])
def test_a_loud_tone_beside_the_mains_is_not_theirs(read_both, frequency, family):
    """A third of a line of a recording of 1 s, which a faint tone would be uncertain by; mains are off by 0.1 Hz."""
    records = toned(read_both(Bench(tone=10 * TONE, tone_frequency=frequency)))
    for i, part in enumerate(assemble(records).parts):
        assert {s.family for s in _between(i, part, Point({}, {}))} == {family}


@pytest.mark.parametrize("frequency", [61.7, 60.6, 73.0])
def test_a_tone_that_another_recording_shows_is_seen_beside_harmonics_of_the_drive(tmp_path, frequency):
    """Around 60 Hz no tone is looked for under a sine of 20 Hz, but one of the same frequency is believed."""
    bench = Bench(tone=10 * TONE, tone_frequency=frequency)
    _, records = read_records(write_campaign(tmp_path, bench, {"noise": "fit", "sine": "fit"}, 1.0, 0))
    alone = with_tones(records[1]).tones
    assert [t.frequency == pytest.approx(frequency, abs=0.1) for t in alone] == ([True] if frequency > 65 else [])
    for record in toned(records):
        (tone,) = record.tones
        assert tone.frequency == pytest.approx(frequency, abs=0.05)


def test_tones_that_are_nearly_one_have_columns_of_their_own(read):
    """Three times a rotation at 50.013 Hz lies beside the third harmonic of the mains, and both are unknown."""
    record, amplitude, found = read(Bench(), "noise"), {"opened": np.ones(1, complex)}, {}
    for frequency in (150.01, 150.04):
        found |= nuisance_columns(record, Tone(frequency, amplitude, 1e4), ("plant",))
    assert len(found) == 4


@pytest.mark.parametrize(("mode", "seen"), [(51.5, 0), (300.0, 1)])
def test_beside_a_mode_a_tone_of_the_mains_is_what_noise_makes_of_it(read, mode, seen):
    record = replace(read(Bench(), "noise"), tones=(Tone(50.2, {"opened": np.array([1e-7 + 0j])}, 100.0),))
    point = Point({"sensor_resonance": {"frequency": mode, "damping_ratio": 0.016, "coupling": 0.06}}, {})
    assert len(_between(0, SimpleNamespace(record=record), point)) == seen
