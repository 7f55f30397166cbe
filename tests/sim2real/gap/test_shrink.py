"""How far a gap shrinks: intervals by simulated coverage, and an engineer's words against the linear loop."""

from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign

from maglev_env.experiment import protocol_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import experiment_at, tolerances
from sim2real.compared.problem import assemble
from sim2real.gap.fit_figures import _reading
from sim2real.gap.shrink import Gap, Words, closed, errors, lost, shrink
from sim2real.recorded.opened import Opened
from sim2real.recorded.records import read_records
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

FREE = load_rig("hmb_free")
SIZE = 400


def whitened(rng, bias):
    return bias + rng.standard_normal(bias.size) + 1j * rng.standard_normal(bias.size)


@pytest.mark.parametrize("left", [0.0, 0.3])
def test_the_interval_of_the_closed_fraction_covers(left):
    """What is left is alike on neighbouring lines; noise is drawn anew for each of 300 campaigns."""
    rng = np.random.default_rng(1)
    smooth = np.repeat(rng.standard_normal(SIZE // 8) + 1j * rng.standard_normal(SIZE // 8), 8)
    shape = 3.0 * smooth * np.sqrt(2 * SIZE) / np.linalg.norm(smooth)
    true, inside, widths = 1 - left**2, 0, []
    for seed in range(300):
        noise = whitened(rng, np.zeros(SIZE))
        fraction, (lo, hi) = closed(shape + noise, left * shape + noise, seed)
        inside += lo <= true <= hi
        widths.append(hi - lo)
        assert lo <= fraction <= hi
    assert inside / 300 >= 0.9 and np.median(widths) < 0.25


def test_what_cannot_be_told_is_none():
    rng = np.random.default_rng(2)
    noise = whitened(rng, np.zeros(SIZE))
    assert closed(noise, noise, 0) == (None, None)
    fallen = np.full(SIZE, np.nan + 0j)
    assert closed(fallen, noise, 0) == (None, None)  # a rotor that fell gives nothing to compare with
    assert closed(noise + 3, fallen, 0) == (None, None)
    same = closed(noise + 3, noise + 3, 0)
    assert same[0] == 0.0 and same[1] == (0.0, 0.0)
    assert closed(noise + 3, noise + 6, 0)[0] < -1  # worse than before


@pytest.mark.parametrize(("noise", "left", "true"), [(1.0, 0.0, 1.0), (1.0, 0.4, 0.84), (0.7, 0.0, 1.0)])
def test_a_clear_gap_in_few_lines_has_a_closed_share(noise, left, true):
    """Such as a resonance's; also where the noise was assumed larger than it is."""
    rng, inside = np.random.default_rng(6), 0
    for seed in range(200):
        own = noise * whitened(rng, np.zeros(SIZE))
        gap = np.zeros(SIZE)
        gap[40:44] = 60.0 * rng.choice([-1, 1], 4)
        fraction, (lo, hi) = closed(gap + own, left * gap + own, seed)
        inside += lo <= true <= hi
        assert lo <= fraction <= hi and fraction == pytest.approx(true, abs=0.03)
    assert inside / 200 >= 0.9


def test_what_predicts_worse_than_calibration_is_told_from_scatter():
    rng = np.random.default_rng(5)
    alike, worse = [], []
    for _ in range(200):
        noise = whitened(rng, np.zeros(SIZE))
        one, other = (noise + 0.05 * whitened(rng, np.zeros(SIZE)) for _ in range(2))  # neither nearer to the truth
        alike.append(lost(one, other))
        worse.append(lost(noise, noise + 0.8 * np.repeat(rng.standard_normal(SIZE // 8), 8)))
    assert np.mean(np.array(alike) > 0) < 0.06
    assert np.mean(np.array(worse) > 0) > 0.95 and np.mean(worse) == pytest.approx(0.64 * SIZE, rel=0.1)
    assert lost(noise, np.full(SIZE, np.nan + 0j)) == 0.0  # a rotor that fell is refused elsewhere


def test_a_gap_that_is_hardly_above_the_noise_has_no_closed_share():
    """Few blocks hold all of the gap, and the noise was taken too large elsewhere, as at steps."""
    rng = np.random.default_rng(3)
    before, after = 0.8 * whitened(rng, np.zeros(SIZE)), 0.7 * whitened(rng, np.zeros(SIZE))
    before[: SIZE // 20] += 5.0
    assert np.mean(abs(before) ** 2) / 2 > 1.1
    assert closed(before, after, 0) == (None, None)


@pytest.fixture(scope="module")
def delayed(tmp_path_factory):
    """A campaign with a delay; calibration, the delay and the mass fitted to it."""
    folder = campaign(tmp_path_factory.mktemp("s") / "c", effects=effect("delay", 7.5e-5), names=("base", "holdout"))
    _, records = read_records(folder)
    fitted, judged = (assemble([r for r in records if r.role == role]) for role in ("fit", "holdout"))
    hypotheses = [Hypothesis(names, tolerances(FREE)) for names in ((), ("delay",), ("mass",))]
    first = [
        np.zeros(h.size) + 0.5 * np.r_[np.ones(len(h.coordinates)), np.zeros(len(h.calibrated))] for h in hypotheses
    ]
    fits = begin(hypotheses, first, fitted.data, fitted.simulate)
    iterate(fits, fitted.data, fitted.simulate, 6)
    return judged, Attribution(fits[0].cost, tuple(map(Candidate, fits)), 2.0 * fitted.data.size, fitted)


@pytest.mark.slow
def test_the_gap_shrinks_to_the_noise_with_the_right_effect_and_not_without(delayed):
    judged, attribution = delayed
    found = shrink(judged, attribution, attribution.of("delay"), "holdout", 0)
    assert found.before > 5 and found.calibrated < found.before
    assert 0.9 < found.after < 1.1 and found.floor == 1.0 and found.judged_on == "holdout"
    assert found.closed_fraction > 0.99 and found.closed_fraction_ci[0] < found.closed_fraction_ci[1]
    assert found.foils["another effect"] > 2 * found.after  # the mass
    assert found.foils["refit all parameters"] > 2 * found.after
    nothing = shrink(judged, attribution, None, "holdout", 0)
    assert nothing.after == nothing.calibrated == found.calibrated and nothing.before == found.before
    assert nothing.closed_fraction < found.closed_fraction


@pytest.mark.slow
def test_an_engineers_words_are_those_of_the_loop(delayed):
    """Peak sensitivity against the linear loop with the delay and without it; stiffness and damping of the receptance
    at the lines of the force in the target band."""
    judged, attribution = delayed
    found = shrink(judged, attribution, attribution.of("delay"), "holdout", 0)
    record = judged.parts[0].record
    truth = experiment_at(protocol_experiment(FREE), SimpleNamespace(effects=effect("delay", 7.5e-5), changes={}))
    lo, hi = FREE.target.band
    band = record.driven["force"][0] & (record.frequency >= lo) & (record.frequency <= hi)
    for when, e in (("measured", truth), ("before", protocol_experiment(FREE)), ("after", truth)):
        response = loop_response(e, record.frequency)
        words = found.words[when]
        peak = abs(response.sensitivity[record.driven["current"][0] & ~record.masked]).max()
        assert words.peak_sensitivity == pytest.approx(peak, rel=0.02)
        omega = 2 * np.pi * record.frequency[band & ~record.masked]
        dynamic = 1 / response.receptance[band & ~record.masked]
        stiffness = dynamic.real + FREE.mass * omega**2
        damping = dynamic.imag / omega
        assert stiffness.min() * 0.98 < words.stiffness < stiffness.max() * 1.02
        assert damping.min() * 0.9 < words.damping < damping.max() * 1.1
    for name in ("stiffness", "damping", "peak_sensitivity"):
        off = errors(found, name)
        assert abs(off["after"]) < 0.03 and abs(off["after"]) <= abs(off["before"])
    assert abs(errors(found, "damping")["before"]) > 0.1  # a delay takes damping away


def test_errors_that_are_not_known_are_none():
    words = {"measured": Words(2.0, 0.0, np.nan), "before": Words(3.0, 1.0, 1.0), "after": Words(2.0, np.nan, 2.0)}
    gap = Gap(None, None, None, 1.0, None, None, "holdout", words, {})
    assert errors(gap, "stiffness") == {"before": 0.5, "after": 0.0}
    assert errors(gap, "damping") == {"before": None, "after": None}
    assert errors(gap, "peak_sensitivity") == {"before": None, "after": None}


def test_the_reading_is_found_behind_a_controller_that_reads_the_current():
    """The figures of a fit and the missing force go backwards through the same loop as the residuals."""
    rng = np.random.default_rng(0)
    blocks = [rng.normal(size=(1, 4)) + 1j * rng.normal(size=(1, 4)) for _ in range(7)]
    opened = Opened(*blocks, ("plant", "amplifier"))
    y, i = (rng.normal(size=(1, 4)) + 1j * rng.normal(size=(1, 4)) for _ in range(2))
    part = SimpleNamespace(opened=opened, used=np.ones(4, bool))
    np.testing.assert_allclose(_reading(part, opened.residuals(y, i)), y, rtol=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "grows"), [(7.48, 8.11, True), (7.48, 7.5, False), (3.0, None, True), (None, 2.0, False)]
)
def test_a_corrected_rig_that_is_worse_than_the_nominal_one_is_known_as_such(before, after, grows):
    assert Gap(before, None, after, 1.0, None, None, "holdout", {}, {}).grows == grows
