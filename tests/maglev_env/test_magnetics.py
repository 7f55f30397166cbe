"""The force law against the dissertation's equation, its own energy, and the measured figures."""

import numpy as np
import pytest
from reference_simulator import force_law as written_out

from maglev_env.magnetics import MU_0, force, force_law, inductance, linearise
from maglev_env.rig import load_rig, with_parameters

RAW = {"actuator_gain": None, "negative_stiffness": None, "bearings": 1}


@pytest.mark.parametrize("flux_path", ["gap", "magnet"])
@pytest.mark.parametrize("calibrated", [True, False])
def test_the_law_is_the_equation_as_written(flux_path, calibrated):
    rig = with_parameters(load_rig("hmb_free"), {"flux_path": flux_path} | ({} if calibrated else RAW))
    y, i = np.meshgrid(np.linspace(-3e-4, 3e-4, 13), np.linspace(-2, 2, 9))
    np.testing.assert_allclose(force(force_law(rig), y, i), written_out(rig)(y, i), rtol=2e-7, atol=1e-9)


def test_one_pair_through_the_magnet_has_half_the_published_coefficients():
    rig = with_parameters(load_rig("hmb_free"), RAW | {"flux_path": "magnet"})
    gain, stiffness = linearise(force_law(rig))
    # eq 3.12 and 3.13 give 1.281 N/A and -12.49 N/mm: twice the derivatives of eq 3.10.
    assert gain == pytest.approx(0.640, abs=5e-4)
    assert stiffness == pytest.approx(-6243, abs=1)


def test_flux_through_the_gaps_alone_explains_the_measured_gain_and_inductance():
    rig = with_parameters(load_rig("hmb_free"), RAW)
    law = force_law(rig)
    bias = law.magnet_flux / (law.gap + law.magnet_gap)
    assert bias == pytest.approx(0.548, abs=5e-4)
    assert bias * rig.turns * rig.pole_area / rig.gap == pytest.approx(5.53, abs=5e-3)
    assert inductance(rig) == pytest.approx(0.571e-3, rel=1e-3)
    assert inductance(rig) == pytest.approx(rig.turns**2 * MU_0 * rig.pole_area / (2 * rig.gap))


@pytest.mark.parametrize("flux_path", ["gap", "magnet"])
def test_linearisation_is_the_derivative_and_hits_the_calibration(flux_path):
    law = force_law(with_parameters(load_rig("hmb_free"), {"flux_path": flux_path}))
    gain, stiffness = linearise(law)
    assert (gain, stiffness) == (pytest.approx(5.7), pytest.approx(-12.5e3))
    assert (force(law, 0, 1e-4) - force(law, 0, -1e-4)) / 2e-4 == pytest.approx(gain, rel=1e-9)
    assert -(force(law, 1e-8, 0) - force(law, -1e-8, 0)) / 2e-8 == pytest.approx(stiffness, rel=1e-6)


def test_force_is_the_work_of_the_field_when_flux_runs_through_the_magnet():
    # One circuit, one gap pair: f dy = -d(field energy) at constant flux; by co-energy, f = dW'/dy at constant current.
    rig = with_parameters(load_rig("hmb_free"), RAW | {"flux_path": "magnet"})
    law = force_law(rig)
    mu_m = rig.recoil_permeability * MU_0
    source = rig.remanence * rig.magnet_length / mu_m
    reluctance = rig.magnet_length / (mu_m * rig.magnet_area)

    def co_energy(y, i):
        upper = 0.5 * (rig.turns * (rig.bias_current + i) + source) ** 2
        lower = 0.5 * (rig.turns * (rig.bias_current - i) + source) ** 2
        gaps = [2 * (rig.gap - y) / (MU_0 * rig.pole_area), 2 * (rig.gap + y) / (MU_0 * rig.pole_area)]
        return upper / (gaps[0] + reluctance) + lower / (gaps[1] + reluctance)

    for y, i in [(0.0, 0.1), (5e-5, -0.3), (-1e-4, 0.5)]:
        d = 1e-8
        work = (co_energy(y + d, i) - co_energy(y - d, i)) / (2 * d)
        # D eq 3.10 counts the pull of one gap of each circuit; the work counts both.
        assert 2 * force(law, y, i) == pytest.approx(work, rel=1e-6)


def test_a_rig_without_magnets_has_no_law():
    with pytest.raises(ValueError, match="no force law"):
        force_law(load_rig("pedestal"))
