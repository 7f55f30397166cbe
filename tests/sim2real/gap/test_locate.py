"""Where a gap lies: the block of an effect, its band and its kind of lines, on small simulated campaigns."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign, planned, write
from scipy.signal import lfilter

from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import LinearController
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.gap.locate import (
    ACTUATOR,
    ALL_DRIVEN,
    DRIVE,
    PLANT,
    RECEPTANCE,
    WHOLE,
    _of_part,
    controller_distance,
    locate,
)
from sim2real.recorded.records import read_records
from sim2real.report import where_in_words

FREE = load_rig("hmb_free")
ONE = ("base",)
NONE = Point({}, {})


def problem_of(folder, rig="hmb_free", effects=None, **options):
    return assemble(read_records(campaign(folder, rig, effects or {}, **{"names": ONE, **options}))[1])


def where(problem, tones=0.0):
    """Of what the nominal rig leaves."""
    return locate(problem, problem.data - problem.simulate([NONE])[0], tones)


@pytest.fixture(scope="module")
def quiet(tmp_path_factory):
    """A campaign without effect."""
    return problem_of(tmp_path_factory.mktemp("q") / "c", names=("base", "half"))


def blamed(found) -> str:
    return max(found.blocks, key=found.blocks.get)


@pytest.mark.parametrize(
    ("effects", "block", "least"),
    [
        (effect("delay", 7.5e-5), DRIVE, 0.8),
        (effect("amplifier_lag", 8e-5), DRIVE, 0.8),
        (effect("actuator_gain", 0.3), ACTUATOR, 0.8),
        (effect("eddy_current", 800.0), ACTUATOR, 0.6),
        (effect("mass", 0.3), RECEPTANCE, 0.8),
        (effect("sensor_gain", -0.2), RECEPTANCE, 0.8),
        (effect("sensor_lag", 8e-5), RECEPTANCE, 0.8),
        (effect("damping", 20.0), RECEPTANCE, 0.8),
    ],
)
def test_an_effect_is_found_in_its_block(tmp_path, effects, block, least):
    """With lines enough in every third octave, 2 Hz apart, to tell the current's force from the shaker's."""
    e = diagnosis_campaign(FREE, FREE.gains, effects, 0)[0].experiment
    found = where(assemble(read_records(write(tmp_path, [("base", "fit", replace(e, periods=3))]))[1]))
    assert blamed(found) == block and found.blocks[block] > least
    assert found.significant
    for shares in (found.blocks.values(), found.kind.values(), [share for *_, share in found.bands]):
        assert sum(shares) == pytest.approx(1.0, abs=1e-9) and min(shares) >= 0


def test_blocks_whose_channels_are_missing_are_told_together(tmp_path):
    delay = effect("delay", 7.5e-5)
    without = where(problem_of(tmp_path / "d", effects=delay, keep=("displacement", "force", "injection")))
    assert without.blocks == {WHOLE: 1.0}
    rows = [(p.name, p.role, p.experiment) for p in planned(FREE, effect("mass", 0.3), ONE)]
    injected = [(n, r, replace(e, excitations=e.excitations[1:])) for n, r, e in rows]
    found = where(assemble(read_records(write(tmp_path / "i", injected))[1]))
    assert set(found.blocks) == {DRIVE, PLANT} and found.blocks[PLANT] > 0.9
    pedestal = where(problem_of(tmp_path / "p", "pedestal", effect("mass", 0.1)))
    assert pedestal.blocks == {RECEPTANCE: 1.0} and pedestal.controller is None


def test_what_is_off_along_one_axis_alone_is_said_to_lie_there(tmp_path):
    """A probe of y that reads 20 % too much, in recordings that drive both axes alike."""
    rig, half = load_rig("hmb_radial"), effect("sensor_gain", np.sqrt(1.2) - 1)  # the rest is apart, to both sides
    rows = [(p.name, p.role, replace(p.experiment, apart={"sensor_gain": 0.2})) for p in planned(rig, half, ONE)]
    found = where(assemble(read_records(write(tmp_path, rows, "hmb_radial"))[1]))
    assert found.axes["y"] > 0.95 and sum(found.axes.values()) == pytest.approx(1.0)
    assert any(line.startswith("axes: y ") for line in where_in_words(SimpleNamespace(where=found)))


def test_without_a_gap_nothing_is_significant(quiet):
    found = where(quiet)
    assert not found.significant and found.controller < 2 and not found.axes


def test_a_band_holds_its_resonance(tmp_path):
    mode = effect("sensor_resonance", frequency=140.0, damping_ratio=0.02, coupling=0.1)
    found = where(problem_of(tmp_path, effects=mode))
    lo, hi, share = max(found.bands, key=lambda band: band[2])
    assert lo <= 140.0 * 2 ** (1 / 3) and hi >= 140.0 * 2 ** (-1 / 3) and share > 0.25


def test_the_kind_is_not_told_where_all_lines_are_excited(quiet):
    """A distortion then shows on the excited lines alone, and all of it would pass for linear."""
    assert where(quiet).between
    driven = replace(quiet, kind=np.zeros_like(quiet.kind))
    found = where(driven)
    assert not found.between
    said = where_in_words(SimpleNamespace(where=replace(found, significant=True)))
    assert said[-1] == f"kind: {ALL_DRIVEN}"


@pytest.mark.parametrize(
    ("effects", "kind"),
    [(effect("asymmetric_gain", 0.3), "even"), (effect("friction", force=0.2, velocity=1e-3), "odd")],
)
def test_distortion_is_seen_on_its_own_lines(tmp_path, effects, kind):
    """A gain that differs between the sides is even; friction is odd. Beside it the excited lines change."""
    found = where(problem_of(tmp_path, effects=effects))
    rest = {k: v for k, v in found.kind.items() if k != "linear"}
    assert max(rest, key=rest.get) == kind and found.kind[kind] > 3 * sorted(rest.values())[-2] + 1e-4


def test_a_linear_gap_is_on_excited_lines_and_a_tone_between_them(tmp_path, quiet):
    found = where(problem_of(tmp_path, effects=effect("mass", 0.3)))
    assert found.kind["linear"] > 0.99
    tone = where(quiet, tones=1e6)
    assert tone.significant and tone.kind["unsynchronised"] > 0.99


def test_another_controller_than_described_is_noticed(tmp_path, quiet):
    assert controller_distance(quiet) < 1.5
    text = (path := campaign(tmp_path / "c", names=ONE) / "campaign.toml").read_text()
    path.write_text(text.replace("kp = 8000.0", "kp = 7000.0"))
    assert controller_distance(assemble(read_records(tmp_path / "c")[1])) > 20
    path.write_text(text.replace("td = 0.0001", "td = 0.0002"))
    assert controller_distance(assemble(read_records(tmp_path / "c")[1])) > 10


def test_a_filter_is_a_controller_too(quiet):
    """Its command as scipy's filter makes it of the reading, in the steady state."""
    part = quiet.only(quiet.parts[0]).parts[0]
    law = LinearController((42667.0, -40000.0), (1.0, -0.6667))
    n = part.record.experiment.samples_per_period
    reading = np.tile(part.record.series["displacement"][0, :n], 3)
    command = lfilter(law.numerator, law.denominator, -reading)[-n:] + part.record.waves["current"][0]

    def spectra(values):
        return np.repeat((np.fft.rfft(values)[part.record.lines] * 2 / n)[None, None], 3, axis=0)

    periods = {"displacement": spectra(reading[:n]), "command": spectra(command)}
    record = replace(part.record, experiment=replace(part.record.experiment, gains=law), periods=periods)
    assert controller_distance(assemble([record])) < 0.1
    other = replace(record, experiment=replace(record.experiment, gains=replace(law, numerator=(42000.0, -40000.0))))
    assert controller_distance(assemble([other])) > 20


def test_no_command_no_word_of_the_controller(tmp_path):
    problem = problem_of(tmp_path, keep=("displacement", "current", "force", "injection"))
    assert controller_distance(problem) is None
    assert np.isfinite(problem.data).all()


def test_along_an_axis_without_a_force_the_actuator_is_not_told_from_what_it_moves():
    """A shaker pushes along x alone; what differs along y is in either."""
    n = 24
    ones, pushed = np.ones((2, n)), np.array([np.arange(n) % 2 == 0, [False] * n])
    record = SimpleNamespace(
        experiment=SimpleNamespace(rig=SimpleNamespace(controlled=True)),
        driven={"force": pushed, "current": np.array([~pushed[0], [True] * n])},
        frequency=np.geomspace(20.0, 60.0, n),
        mean=lambda name: ones,
        driving=lambda name: pushed * (1.0 + 1.0j),
    )
    opened = SimpleNamespace(outputs=("plant", "amplifier"), plant=ones, amplifier=ones, receptance=ones)
    part = SimpleNamespace(record=record, opened=opened, noise=np.ones((2, 2, n)), used=np.ones(n, bool))
    for axis, told in ((0, True), (1, False)):
        r = np.zeros((2, 2, n), complex)
        r[0, axis] = 10.0  # the reading alone, in proportion to the current: the actuator where that is told
        found = _of_part(part, r, np.ones((2, 2, n), bool))
        largest = max(found, key=lambda block: found[block])
        assert largest == (ACTUATOR if told else PLANT)
