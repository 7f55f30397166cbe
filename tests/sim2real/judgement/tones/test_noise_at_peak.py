"""Lines of noise that are louder than the level from which a tone would stand out there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from estimation.lines.line_windows import LineWindows
from estimation.lines.tones import Tone
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import NOMINAL, Point
from sim2real.judgement.tones import noise_at_peak as module
from sim2real.judgement.tones.noise_at_peak import noise_at_peak
from sim2real.recorded.open_record import OpenRecord


@pytest.mark.parametrize(("off", "chi2", "noise"), [(1.0, 60.0, True), (1.5, 60.0, False), (1.0, 2000.0, False)])
def test_a_tone_at_a_resonance_narrower_than_a_window_must_exceed_the_noise_there(off, chi2, noise):
    """White forces make the lines at the peak of a rotor on springs louder than those about them; where
    one in 100,000 records may show a tone by noise, chi-square 60 is none there, and one elsewhere."""
    rig = replace(load_rig("eframe"), support_stiffness=40e3, support_damping=4.0, mass=0.3)
    e, windows = Experiment(rig, rig.gains, ()), LineWindows(5000, rig.control_rate / 5, 1, 20)
    record = OpenRecord("", "fit", rig, e, {}, {}, np.zeros((1, 0)), np.zeros((1, 0)), 0, windows)
    f = np.arange(20.0, 80.0, 0.05)
    peak = f[abs(loop_response(e, f).plant).argmax()]
    assert noise_at_peak(record, NOMINAL, Tone(off * peak, {}, chi2)) == noise


def test_noise_stands_out_where_the_nominal_rotor_resonates_and_not_where_the_true_one_does():
    """The recording was opened as the nominal loop, by 1 + P C, and was closed by the true one."""
    rig = replace(load_rig("eframe"), support_stiffness=40e3, support_damping=6.0, mass=0.3)
    e, windows = Experiment(rig, rig.gains, ()), LineWindows(1500, rig.control_rate / 5, 1, 20)
    record = OpenRecord("", "fit", rig, e, {}, {}, np.zeros((1, 0)), np.zeros((1, 0)), 0, windows)
    true = replace(e, rig=replace(rig, support_stiffness=32e3))
    f = np.arange(20.0, 80.0, 0.05)
    nominal_peak, true_peak = (f[abs(loop_response(own, f).plant).argmax()] for own in (e, true))
    point = Point({"support_stiffness": {"change": -0.2}}, {})
    assert noise_at_peak(record, point, Tone(nominal_peak, {}, 60.0))
    assert not noise_at_peak(record, point, Tone(true_peak, {}, 60.0))
    left = abs(loop_response(true, f).sensitivity / loop_response(e, f).sensitivity)  # of the probe's noise
    assert left.max() > 3.0 and abs(f[left.argmax()] / nominal_peak - 1) < 0.02


@pytest.mark.parametrize(("least", "noise"), [(0.05, True), (1.0, False)])
def test_between_harmonics_a_notch_of_the_sensitivity_hides_no_noise_beside_it(least, noise, monkeypatch):
    """A rotor on springs leaves next to nothing of its probe's noise about its resonance. A line beside that stands far
    above the median of its neighbours, by noise alone."""

    def notched(_, f):
        return SimpleNamespace(sensitivity=np.where(abs(f - 33.0) < 22.0, least, 1.0), receptance=np.ones_like(f))

    monkeypatch.setattr(module, "loop_response", notched)
    rig = load_rig("eframe")
    e = Experiment(rig, rig.gains, (Excitation("multisine", "current", 4.0, (1, 3, 5), 0.1),))
    series = {"displacement": np.zeros((1, 5 * e.samples_per_period))}
    record = SimpleNamespace(experiment=e, series=series, count=5, axes=1)
    assert noise_at_peak(record, NOMINAL, Tone(10.0, {}, 60.0)) == noise
    assert not noise_at_peak(record, NOMINAL, Tone(35.0, {}, 60.0))
