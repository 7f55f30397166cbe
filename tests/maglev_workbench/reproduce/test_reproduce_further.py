"""Motor, averaging, mallet, pedestal damping, filters and single rows: against closed forms, scipy and simulation."""

from functools import lru_cache

import numpy as np
import pytest
from scipy import signal

from estimation.least_squares import least_squares
from estimation.multisine.sphs import impulse, synthesise
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapters.bearing import flux_map, motor_drive
from maglev_workbench.commands.reproduce.chapters.coefficients.pedestal_damping import standard_error
from maglev_workbench.commands.reproduce.chapters.identification.mallet import TOP, _momentum
from maglev_workbench.commands.reproduce.registry import HOME, chosen

NAMES = ("flux-map", "motor", "averaging", "mallet", "pedestal-damping", "digital-filters")
DIFFERS = {
    "flux-map": [
        "radial force of one face, Table 3.3",
        "axial stiffness, two faces (one stack)",
        "axial stiffness, eight faces (one bearing)",
        "axial mode of the test rig by two bearings of it",
    ],
    "motor": ["the same with six steps of 120 degrees"],
    "pedestal-damping": ["goodness of fit, 30-100 Hz, least of what was tried"],
}


@lru_cache
def outcome(name, seed=0):
    return chosen([name])[0].run(seed)


def found(name, row):
    (value,) = [r.found for r in outcome(name).rows if r.name == row]
    return value


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_rows_are_whole_and_those_that_differ_say_why(name):
    rows = outcome(name).rows
    assert len({row.name for row in rows}) == len(rows) and all(np.isfinite(row.found) for row in rows)
    assert [row.name for row in rows if row.agrees is False] == DIFFERS.get(name, [])
    assert all(row.reason for row in rows if row.agrees is False or (row.difference is not None and not row.kind))
    assert {row.again for row in rows} <= {"", *HOME}
    assert outcome(name).plots


def test_the_motors_torque_is_that_of_a_current_sheet():
    """Eq 3.6's integral with the deltas of eq 3.5 as narrow strips, over a full turn."""
    angle = np.linspace(0, 2 * np.pi, 25)
    theta = (np.arange(48_000) + 0.5) / 48_000 * 2 * np.pi
    half = np.pi / 480
    for phi in (0.0, 0.7):
        current = motor_drive.currents(angle, phi)
        total = np.zeros(len(angle))
        for sides, i in zip(motor_drive.SIDES, current, strict=True):
            for place, sign in sides:
                off = np.angle(np.exp(1j * (theta - place * np.pi / 24)))
                strip = (np.abs(off) < half) / (2 * half)
                field = -np.sin(angle[:, None] - 4 * theta)
                total += sign * i * (field * strip).sum(axis=1) * (2 * np.pi / len(theta))
        assert motor_drive.torque(angle, current) == pytest.approx(total, rel=2e-3)
        assert motor_drive.torque(angle, current) == pytest.approx(-6 * np.cos(phi), rel=1e-9)


def test_six_steps_ripple_as_a_cosine_over_sixty_degrees():
    top, bottom = 1.0, np.cos(np.pi / 6)
    mean = np.sin(np.pi / 6) / (np.pi / 6)
    assert found("motor", "the same with six steps of 120 degrees") == pytest.approx((top - bottom) / mean, rel=2e-3)
    ratio = found("motor", "torque of six steps over that of sines with the same peak")
    assert ratio == pytest.approx(2 * np.sqrt(3) / np.pi, rel=2e-3)


def test_a_blow_is_one_pulse_of_the_stated_area():
    n = 20_000
    wave = synthesise(impulse(np.arange(1, TOP + 1), n, peak=8.0), n)
    assert wave.argmax() == 0 and wave.max() == pytest.approx(8.0)
    centred = np.roll(wave, n // 2)
    inside = slice(n // 2 - n // 4, n // 2 + n // 4)  # the lobes on both sides cancel but for the mean that is missing
    area = centred[inside].sum() / n + 8.0 / (2 * TOP) * 0.5
    assert area == pytest.approx(_momentum(8.0), rel=0.02)
    assert wave.mean() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_a_blow_identifies_the_platform_as_sphs_does():
    assert found("mallet", "stiffness, 14-24 Hz, by the blow over that by SPHS") == pytest.approx(1.0, abs=0.08)
    assert 5 < found("mallet", "greatest blow that it bears") < 100


@pytest.mark.slow
def test_averaging_divides_noise_by_the_root_of_the_periods():
    assert found("averaging", "scatter of the response, 5 periods over 20") == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize(("band", "fit"), [((60.0, 70.0), 0.9952), ((30.0, 100.0), 0.91)])
def test_the_error_that_a_published_fit_implies(band, fit):
    """A simulated residual of that size: eq 4.22's error by the estimator, from records of one damped mode."""
    f, k, m, c = np.arange(band[0], band[1] + 0.1, 0.5), 134.5e3, 0.79, 60.0
    w, rng = 2 * np.pi * f, np.random.default_rng(5)
    clean = 1 / (k + 1j * w * c - m * w**2)
    got = []
    for _ in range(40):
        residual = rng.normal(size=f.size) + 1j * rng.normal(size=f.size)
        size = np.sqrt((1 - fit**2) * np.sum(np.abs(clean * (k + 1j * w * c)) ** 2) / np.sum(np.abs(residual) ** 2))
        # The residual of eq 4.13 is (m w^2 - k - j w c) times the error of G.
        error = size * residual / (m * w**2 - k - 1j * w * c)
        one = least_squares(f, clean + error, m)
        got.append((one.damping_se / standard_error(np.array(band), 134.5, one.goodness_of_fit), one.goodness_of_fit))
    assert np.median([ratio for ratio, _ in got]) == pytest.approx(1.0, abs=0.12)


def test_the_filters_corners_by_scipy():
    for kind, published, row in (("high", 15e3, "high"), ("low", 5e3, "low")):
        taps = signal.bilinear(*signal.butter(2, 2 * np.pi * published, kind, analog=True), 250e3)
        corner = 1e3 * found("digital-filters", f"corner of the {row}-pass, -3 dB")
        _, h = signal.freqz(*taps, worN=[corner], fs=250e3)
        assert np.abs(h[0]) == pytest.approx(1 / np.sqrt(2), rel=1e-6)
        assert corner == pytest.approx(250e3 / np.pi * np.arctan(np.pi * published / 250e3), rel=1e-6)


def test_the_pull_of_a_pole_face_by_hand():
    mu, b_r, l_m, a_m, a_g, gap = 4e-7 * np.pi, 0.7, 5e-3, 34.715e-6, 39.27e-6, 0.35e-3
    drive, path = b_r * l_m / (1.05 * mu), 2 * gap / mu + l_m * a_g / (1.05 * mu * a_m)
    force = found("axial-force", "radial force at no displacement, eq 3.9")
    assert force == pytest.approx((drive / path) ** 2 * a_g / (2 * mu), rel=1e-6)


def test_the_potential_of_a_square_coaxial_line():
    """An inner square half as wide as the outer one has 10.2341 epsilon_0 a metre (conformal mapping)."""
    n = 160
    y, z = np.mgrid[0 : n + 1, 0 : n + 1]
    inner = (np.abs(y - n / 2) <= n / 4) & (np.abs(z - n / 2) <= n / 4)
    outer = (y == 0) | (y == n) | (z == 0) | (z == n)
    nothing = np.zeros_like(inner)
    value = flux_map.solve(inner | outer, inner.astype(float), nothing)
    assert flux_map.flux(value, inner | outer, inner, nothing) == pytest.approx(10.2341, rel=0.02)


def test_no_flux_enters_a_closed_region():
    """A bar of unit potential over a plate, half of it behind a closed block: width over distance is left."""
    y, z = np.mgrid[0:21, 0:81]
    fixed, closed = (y == 0) | (y == 20), (y > 0) & (y < 20) & (z > 40)
    value = flux_map.solve(fixed, (y == 20).astype(float), closed)
    assert flux_map.flux(value, fixed, y == 20, closed) == pytest.approx(41 / 20, rel=1e-9)


def test_the_ring_is_drawn_back_to_its_pole():
    """The permeance is greatest opposite the pole; and parallel lines give the field of eq 3.7."""
    totals = [flux_map.section(0.35e-3, s).total for s in (-2, 0, 2)]
    assert totals[1] > (totals[0] + totals[2]) / 2
    rig = load_rig("hmb_free")
    plain = flux_map.field(rig, flux_map.RING / rig.gap)
    drive, path = 0.7 * 5e-3 / 1.05, 2 * 0.35e-3 + 5e-3 * 39.27 / (1.05 * 34.715)
    assert plain == pytest.approx(drive / path, rel=1e-6)  # eq 3.7, mu_0 cancelled
