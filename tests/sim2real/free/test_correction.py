"""A free correction of records of a bench of another hand: its place, shape and size, and that it may be nothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.rig_toml import rig_toml
from maglev_workbench.commands.diagnose.free import free_sections
from sim2real.compared.point import tolerances
from sim2real.compared.problem import assemble
from sim2real.free.correction import _rival, free_correction, share_closed
from sim2real.free.drawn import _drawn
from sim2real.free.kinds import CURVE, LINEAR, PLAY, Kind, Sizes, freed, kinds, sizes_of
from sim2real.recorded.records import read_records
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

QUIET = Bench(noise=2e-8, current_noise=1e-4)


def attributed(folder, bench):
    """Calibration of a bench's record, and the problem that judges."""
    _, records = read_records(write_campaign(folder, bench, {"noise": "fit", "noise-2": "holdout"}, 0.5, 0))
    fitted, judged = (assemble([r for r in records if r.role == role]) for role in ("fit", "holdout"))
    rig = records[0].nominal
    base = Hypothesis((), tolerances(rig), scales=rig.scales)
    fits = begin([base], [np.zeros(base.size)], fitted.data, fitted.simulate)
    iterate(fits, fitted.data, fitted.simulate, 6)
    differentiate(fits, fitted.data, fitted.simulate, True)
    return Attribution(fits[0].cost, tuple(map(Candidate, fits)), 2.0 * fitted.data.size, fitted), judged


@pytest.fixture(scope="module")
def dead(tmp_path_factory):
    """Of a bench with a dead band of 15 mA either way."""
    return attributed(tmp_path_factory.mktemp("dead"), replace(QUIET, band=0.015))


@pytest.mark.slow
def test_a_dead_band_is_found_where_it_is(dead):
    attribution, judged = dead
    found = free_correction(attribution, judged, attribution.calibration, False, 0)
    assert found.gained and found.beyond > 0.8 and found.beyond_ci[0] > 0.5
    first = found.drawn[0]
    assert (first.kind.place, first.kind.block) == ("free_command", "amplifier")
    assert "dead band" in found.sentence()
    lost = -0.5 * (first.value[-2] - first.value[1])
    assert lost == pytest.approx(0.015, rel=0.25)
    assert found.to_json()["corrections"][0]["place"] == "free_command"
    (_, words), (_, figure), _ = free_sections(found)
    assert "dead band" in words and len(figure.data) >= 2


@pytest.mark.slow
def test_the_corrected_rig_is_read_back_unchanged(dead, tmp_path):
    attribution, judged = dead
    fit = free_correction(attribution, judged, attribution.calibration, False, 0).candidate.fit
    rig = attribution.problem.parts[0].record.nominal
    corrected = replace(rig, effects=fit.hypothesis.point(fit.u).effects)
    (tmp_path / "corrected.toml").write_text(rig_toml(corrected))
    assert load_rig(tmp_path / "corrected.toml").effects == corrected.effects


@pytest.mark.slow
def test_nothing_is_corrected_where_calibration_explains_all(tmp_path):
    attribution, judged = attributed(tmp_path, replace(QUIET, gain=0.02))
    found = free_correction(attribution, judged, attribution.calibration, False, 0)
    assert found is None or not found.gained


@pytest.mark.slow
def test_coefficients_of_zero_are_the_base(dead):
    attribution, _ = dead
    problem, base = attribution.problem, attribution.calibration.fit
    sizes = sizes_of(problem, base.hypothesis.point(base.u))
    h = freed(base.hypothesis, kinds(problem, sizes), sizes)
    u = np.concatenate([np.zeros(len(h.coordinates)), base.u])
    plain, free = problem.simulate([base.hypothesis.point(base.u), h.point(u)])
    assert abs(plain - free).max() < 1e-6 * abs(plain).max()
    assert {p for p in h.point(u).effects} == {k.place for k in h.added}
    assert h.point(u).effects["free_reading"]["range"] == sizes.of["displacement"]


def test_the_share_that_is_closed_has_its_interval():
    """By simulation: residuals of known excess, half of which is closed."""
    rng, n = np.random.default_rng(1), 200
    gap = 3.0 * rng.standard_normal((n, 2)) @ np.array([1.0, 1.0j])
    noise = rng.standard_normal((100, n, 2)) @ np.array([1.0, 1.0j])
    found = [share_closed(gap + r, np.sqrt(0.5) * gap + r, 0) for r in noise]
    assert np.mean([f[0] for f in found]) == pytest.approx(0.5, abs=0.02)
    assert sum(lo <= 0.5 <= hi for _, (lo, hi) in found) >= 88
    assert share_closed(noise[0], 0.5 * noise[0], 0) == (None, None)
    assert share_closed(np.full(9, np.nan + 0j), np.zeros(9, complex), 0) == (None, None)


def test_corrections_of_one_place_add_what_they_have_in_common():
    """A part that acts at once is one of a linear correction and of a play: both together are their sum."""
    sizes = Sizes(dict.fromkeys(("command", "current", "displacement", "velocity", "force", "share"), 1.0), 1e-3)
    added = [Kind("free_command", shape) for shape in (LINEAR, PLAY)]
    both = freed(Hypothesis((), {}), added, sizes)
    u = np.zeros(both.size)
    first, second = (both.place_of(kind).start for kind in added)
    u[first], u[second] = 0.3, 0.2  # in units of their prior, which is that of the command: 1 A over 1 A
    alone = freed(Hypothesis((), {}), added[:1], sizes)
    own = np.zeros(alone.size)
    own[0] = 0.3
    assert both.point(u).effects["free_command"]["direct"] == pytest.approx(0.5)
    u[second] = 0.0
    assert both.point(u).effects == alone.point(own).effects


@pytest.mark.parametrize(
    ("effects", "named", "refitted", "said"),
    [
        (("delay", "mass"), True, "wide", "delay with mass"),
        ((), True, "wide", "calibration"),  # tones alone are named
        (("delay",), False, "wide", "a refit of every nominal parameter"),
        (("delay",), False, None, "calibration"),  # no parameter has a tolerance
    ],
)
def test_what_it_must_beat_is_called_what_it_is(effects, named, refitted, said):
    partial = SimpleNamespace(effects=effects, fit="+".join(effects) or "calibrated")
    attribution = SimpleNamespace(calibration=SimpleNamespace(fit="calibrated"), refitted=refitted)
    fit, words = _rival(attribution, partial, named)
    assert words == said and fit == (partial.fit if named else refitted or "calibrated")


def test_a_correction_begins_at_the_one_that_the_rig_has_of_its_own():
    own = {"free_command": {"range": 2.0, "time": 4e-3, "direct": 0.1, "p5": 0.3, "h1": 0.05}}
    of = dict.fromkeys(("command", "current", "displacement", "velocity", "force", "share"), 1.0)
    plain, sizes = Sizes(of, 1e-3), Sizes(of, 1e-3, own)
    h = freed(Hypothesis((), {}), [Kind("free_command", shape) for shape in (CURVE, LINEAR)], sizes)
    u = np.zeros(h.size)
    assert sizes.constants("free_command") == plain.constants("free_command") | own["free_command"]
    assert h.point(u).effects == {"free_command": sizes.constants("free_command")}
    linear = h.place_of(h.added[1])
    u[linear.start] = 0.5  # of a prior of 1 A over the 2 A of its own range
    assert h.point(u).effects["free_command"]["direct"] == pytest.approx(0.1 + 0.25)
    curve, factor = (_drawn(h, kind, u, np.eye(h.size), np.array([1.0, 1e6])) for kind in h.added)
    assert curve.range == 2.0 and not curve.value.any()
    slow = Hypothesis((), {}), [Kind("free_command", LINEAR)], Sizes(of, 4e-3)
    expected = _drawn(freed(*slow), slow[1][0], 0.5 * u[linear], np.eye(5), factor.at)
    assert factor.value == pytest.approx(expected.value)


@pytest.mark.slow
def test_a_rig_with_a_correction_of_its_own_stays_what_it_is_where_more_is_looked_for(dead):
    attribution, _ = dead
    record = attribution.problem.parts[0].record
    own = {
        "free_reading": Sizes({"displacement": 5e-5}, 1e-3).constants("free_reading") | {"direct": -0.05, "p5": 2e-6}
    }
    rigs = [replace(rig, effects=own) for rig in (record.nominal, record.experiment.rig)]
    e = replace(record.experiment, rig=rigs[1], effects=own)
    problem, base = assemble([replace(record, nominal=rigs[0], experiment=e)]), attribution.calibration.fit
    sizes = sizes_of(problem, base.hypothesis.point(base.u))
    h = freed(base.hypothesis, kinds(problem, sizes), sizes)
    u = np.concatenate([np.zeros(len(h.coordinates)), base.u])
    plain, free = problem.simulate([base.hypothesis.point(base.u), h.point(u)])
    assert abs(plain - free).max() < 1e-6 * abs(plain).max()
