"""The case studies: their numbers against closed forms, their diagnoses on smaller campaigns, their page."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.diagnosis import diagnose
from sim2real.search import attribute

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "examples"))


def coarse(name: str, fundamental: float, top: float, force: float, injection: float) -> Rig:
    """A preset with fewer lines: 4 of 5 force, the fifth and some beyond injection, as the preset has them."""
    lines = range(1, int(top / fundamental))
    beyond = [int(f / fundamental) for f in (1.3 * top, 1.7 * top, 2.3 * top, 3 * top)]
    shaken, injected = [n for n in lines if n % 5], [*(n for n in lines if n % 5 == 0), *beyond]
    parts = (
        Excitation("sphs", "force", fundamental, tuple(shaken), force),
        Excitation("sphs", "current", fundamental, tuple(injected), injection),
    )
    return replace(load_rig(name), protocol=Protocol(parts))


def answer(folder: Path, *names: str):
    """The diagnosis with only these candidates."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attribute, "single_effects", lambda rig: names)
        return diagnose(folder)


@pytest.fixture
def fits():
    from calibration_dip import candidates, fit

    return {c.name: (c, *fit(c)) for c in candidates()}


def test_what_explains_the_published_features(fits):
    chi2 = {name: found for name, (_, _, found) in fits.items()}
    assert all(chi2[f"{name} + sensor_resonance"] < 1 for name in ("delay", "second-order low-pass"))
    assert chi2["two equal poles + sensor_resonance"] < 3 < chi2["one pole + sensor_resonance"] < 8
    assert chi2["eddy current, order 1/2 + sensor_resonance"] > 40
    # Alone, each side leaves the other's feature: 100 of the phase, 9 of the dip; the probe's gain and lag leave both.
    assert chi2["sensor_resonance"] == pytest.approx(100, abs=0.5)
    assert chi2["delay"] == pytest.approx(9, abs=0.1)
    assert chi2["sensor_gain"] == pytest.approx(109, abs=0.1) and chi2["sensor_lag"] >= 109 - 0.1


def test_fits_agree_with_closed_forms(fits):
    delay = fits["delay"][1][0]
    assert delay == pytest.approx(30 / 360 / 150, rel=0.02)
    corner = 1 / (2 * np.pi * fits["second-order low-pass"][1][0])
    x = (-np.sqrt(2) + np.sqrt(2 + 4 * np.tan(np.pi / 6) ** 2)) / (2 * np.tan(np.pi / 6))  # 30 degrees of a Butterworth
    assert corner == pytest.approx(150 / x, rel=0.01)
    # A slow probe can only make the estimate lead.
    lead = fits["sensor_lag"][0].response(np.array([150.0]), np.array([1e-3]))
    assert np.degrees(np.angle(lead))[0] == pytest.approx(np.degrees(np.arctan(2 * np.pi * 0.15)), abs=1e-9)


def test_a_flat_level_bounds_the_dip():
    from calibration_dip import DAMPING, features, mode

    height = np.tan(np.radians(6))  # of the circle that the response runs through
    *_, dip, level = features(lambda f: 1 / (1 - mode(f, 2 * DAMPING * height)))
    assert dip == pytest.approx(6, rel=0.02)
    assert level == pytest.approx(-20 * np.log10(np.hypot(1 - height / 2, height / 2)), rel=0.05)
    assert 0.4 < level < 0.5  # a dip of much more than 6 degrees would not leave the level flat to 0.5 dB


def test_the_mode_is_the_effect_of_the_vocabulary():
    from calibration_dip import DAMPING, DIP, mode

    rig, f, coupling = replace(load_rig("pedestal"), support_damping=0.0), np.array([20.0, 60.0, 75.0, 90.0]), 0.03
    mount = effect("sensor_resonance", DIP, damping_ratio=DAMPING, coupling=coupling)
    bare, mounted = (loop_response(Experiment(rig, NO_CONTROLLER, (), effects=e), f).receptance for e in ({}, mount))
    size = coupling * rig.support_stiffness / rig.mass / (2 * np.pi * DIP) ** 2
    assert mounted / bare == pytest.approx(1 - mode(f, size), rel=1e-3)
    assert abs(mounted / bare - 1).max() > 0.1


def test_experiments_that_decide_and_those_that_do_not():
    from calibration_dip import ESTIMATE_NOISE, experiments

    d2 = {(what, tells): value for what, tells, value in experiments()}
    lag, place = "delay or second-order low-pass", "the probe's plate or the magnets' side"
    assert d2["calibrate up to 400 Hz", lag] > 50 * d2["calibrate up to 150 Hz", lag]
    assert d2["the same calibration again", place] < 1e-3 * d2["plate twice as stiff", place]
    # A mode of height q over the half-width of its damping, half of it on either side of a compromise.
    gone = 2 * np.pi * 75 * 0.03 / 2 * (np.tan(np.radians(2.95)) ** 2) / ESTIMATE_NOISE**2
    assert d2["a probe that stands elsewhere", place] == pytest.approx(gone, rel=0.1)


def test_noise_beside_the_signal_makes_no_delay():
    from calibration_dip import delay_by_noise

    delay, error = delay_by_noise(5.0)
    assert abs(delay) < 3 * error < 556e-6 / 5


def test_the_page_holds_the_tables_and_the_pictures():
    from calibration_dip import plan, table

    page = (ROOT / "docs" / "case-studies.md").read_text(encoding="utf-8")
    assert [row for row in [*table(), *plan()] if row not in page] == []
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page)
    assert len(pictures) == 2 and all((ROOT / "docs" / name).exists() for name in pictures)


@pytest.mark.slow
def test_the_actuator_gain_is_blamed_and_the_corrected_rig_levitates(tmp_path):
    from actuator_gain_gap import STEP, picture, plants, record, rightmost_pole, step

    from sim2real.corrected import corrected_rig

    measured = coarse("hmb_free", 5.0, 250.0, 0.4, 0.1)
    found = answer(record(tmp_path / "campaign", measured), "actuator_gain", "negative_stiffness", "mass", "delay")
    assert (found.verdict, found.cause) == ("explained", ("actuator_gain",))
    nominal, corrected = found.campaign.rig, corrected_rig(found)
    assert corrected.effects["actuator_gain"]["change"] == pytest.approx(5.7 / 1.281 - 1, rel=0.01)
    assert corrected.gains == nominal.gains == measured.gains
    assert rightmost_pole(nominal) > 100 and rightmost_pole(corrected) == pytest.approx(-42.8, abs=2)
    assert np.isnan(step(nominal)[1]).any() and np.nanmax(abs(step(nominal)[1])) > 300e-6
    assert np.abs(step(corrected)[1]).max() < 3 * STEP
    # Rivals that levitate too, but not as the recordings do.
    problem = found.attribution.problem
    rivals = {"sensor_gain": 5.7 / 1.281 - 1, "negative_stiffness": -0.7}
    left = problem.data - problem.simulate([found.corrected, *(Point(effect(*r), {}) for r in rivals.items())])
    gap = np.sqrt(np.mean(abs(left) ** 2, axis=1) / 2)
    assert gap[0] < 1.1 and gap[1:].min() > 20
    f, plant = plants(found)
    low = f < 200
    assert plant["corrected"][low] == pytest.approx(plant["measured"][low], rel=0.05)
    assert abs(plant["theory"] / plant["corrected"]) == pytest.approx(1.281 / 5.7, rel=0.02)
    picture(found, measured).savefig(tmp_path / "picture.png")


@pytest.mark.slow
def test_the_resonance_of_the_probe_mount_is_named(tmp_path):
    from calibration_dip import picture, record

    folder = record(tmp_path / "campaign", coarse("eframe", 2.5, 200.0, 0.7, 0.15), 0.1)
    found = answer(folder, "sensor_resonance", "support_resonance", "delay")
    assert (found.verdict, found.cause) == ("explained", ("sensor_resonance",))
    mount = found.corrected.effects["sensor_resonance"]
    assert mount["frequency"] == pytest.approx(75, abs=1.5) and mount["coupling"] == pytest.approx(0.1, rel=0.15)
    picture().savefig(tmp_path / "picture.png")
