"""A mode with little damping rings at the ends of an open record, and its lines are no noise of their windows."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.lines.tones import Tone
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.open_tones import with_tones
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.open_evidence import open_noise
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.records import read_records
from sim2real.recorded.ringing import driven_directions, ringing, ringing_directions

SAMPLES, OUTPUTS = 8000, ("plant", "amplifier")


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """An open record of the rotor on its springs, of 0.4 s."""
    folder, rng = tmp_path_factory.mktemp("ringing"), np.random.default_rng(0)
    names = [f"{kind}_{axis}" for kind in ("displacement", "command", "current") for axis in "xy"]
    np.savez(folder / "hover.npz", **{name: 1e-6 * rng.standard_normal(SAMPLES) for name in names})
    text = ['schema = "maglev-campaign/1"', 'rig = "hmb_radial"', "[[recording]]", 'file = "hover.npz"', 'role = "fit"']
    text += ["sample_rate = 20000.0", "gains = { kp = 8000.0, ki = 2000.0, kd = 5.2, td = 1e-4, ti = 0.0318 }"]
    text += ['excitation = { kind = "none" }', "[recording.channels]"]
    text += [f'{name} = {{ from = "{name}" }}' for name in names]
    (folder / "campaign.toml").write_text("\n".join(text))
    _, (found,) = read_records(folder)
    return found


def swinging(record, phase):
    """Angular frequency and decay (1/s) of the rotor on its springs, and how it swings when let go, (samples,)."""
    rig = load_rig("hmb_radial")
    decay = rig.support_damping / (2 * rig.mass)
    swing = np.sqrt((rig.support_stiffness + rig.negative_stiffness) / rig.mass - decay**2)
    t = np.arange(sum(record.series["displacement"].shape[1:])) / rig.control_rate
    return swing, decay, np.exp(-decay * t) * np.cos(swing * t + phase)


@pytest.mark.parametrize("phase", [0.0, 1.1])
def test_how_a_mass_swings_on_springs_is_a_nuisance(record, phase):
    swing, decay, let_go = swinging(record, phase)
    noise = np.ones((2, 2, record.frequency.size))
    columns = ringing(record, nominal_loop(record), OUTPUTS, noise, record.experiment)
    assert len(columns) == 4 and all(f"at {np.hypot(swing, decay) / (2 * np.pi):.4g} Hz" in name for name in columns)
    rung = np.zeros((2, 2, record.frequency.size), complex)
    rung[0, 1] = record.coordinates(let_go)
    known = Nuisances(tuple(columns), 1e3 * np.array([c.ravel() for c in columns.values()]))  # however large it is
    assert np.linalg.norm(known.without(rung.ravel())) < 0.05 * np.linalg.norm(rung)
    other = np.zeros_like(rung)
    other[0, 1] = 1.0  # and what does not ring stays
    assert np.linalg.norm(known.without(other.ravel())) > 0.97 * np.linalg.norm(other)


def test_ringing_is_as_large_as_noise_moves_the_loop(record):
    quiet, loud = (np.full((2, 2, record.frequency.size), size) for size in (1.0, 3.0))
    one, three = (ringing(record, nominal_loop(record), OUTPUTS, noise, record.experiment) for noise in (quiet, loud))
    for name, column in one.items():
        assert np.allclose(three[name], 3 * column)


def test_ringing_is_as_large_however_few_lines_are_compared(record):
    """A slow sine makes the lowest lines alone worth comparing; noise moves the rotor up to the loop's bandwidth."""
    e = record.experiment
    stiff = replace(record, experiment=replace(e, gains=replace(e.gains, kp=10 * e.gains.kp, kd=10 * e.gains.kd)))
    few = replace(stiff, windows=replace(record.windows, count=3))

    def sizes(of):
        noise = np.ones((2, 2, of.frequency.size))
        columns = ringing(of, nominal_loop(of), OUTPUTS, noise, of.experiment)
        return {name: np.linalg.norm(c[..., : few.frequency.size]) for name, c in columns.items()}

    whole = sizes(stiff)
    assert whole and sizes(few) == pytest.approx(whole, rel=0.05)


@pytest.mark.parametrize("times", [1.0, 0.8, 1.6])
def test_a_loud_tone_begins_and_ends_with_the_record(record, times):
    """Wherever it lies, what the mode holds at the ends grows with it, along its axis."""
    swing, _, _ = swinging(record, 0.0)
    noise = np.full((2, 2, record.frequency.size), 1e-9)

    def sizes(tone):
        amplitude = {"opened": np.array([0.0, tone])}
        rung = replace(record, tones=(Tone(times * swing / (2 * np.pi), amplitude, 1e4),))
        columns = ringing(rung, nominal_loop(rung), OUTPUTS, noise, rung.experiment).values()
        return np.array([np.linalg.norm(c[0], axis=-1) for c in columns]).max(axis=0)

    quiet, loud, louder = (sizes(tone) for tone in (0.0, 1e-5, 2e-5))
    assert loud[1] > 5 * quiet[1] and louder[1] == pytest.approx(2 * loud[1], rel=0.05)
    assert loud[0] == pytest.approx(quiet[0])


def test_ringing_neither_counts_as_noise_nor_hides_a_tone(record):
    """A swing of ten times the noise of a sample, along one axis, beside a tone of a tenth of it."""
    swing, _, let_go = swinging(record, 0.4)
    t = np.arange(let_go.size) / record.windows.sample_rate
    tone = 1e-7 * np.sin(2 * np.pi * 1.6 * swing / (2 * np.pi) * t)

    def with_more(more):
        displacement = record.series["displacement"].copy()
        displacement[0] += more
        return replace(record, series={**record.series, "displacement": displacement})

    loop = nominal_loop(record)
    both = record, with_more(1e-5 * let_go)
    alone, rung = (open_noise(r, loop, OUTPUTS, None, record.experiment) for r in both)
    near = abs(record.frequency - swing / (2 * np.pi)) < 60.0
    assert np.max(abs(np.log(rung[0, 0, near] / alone[0, 0, near]))) < 0.1
    (found,) = with_tones(with_more(1e-5 * let_go + tone)).tones
    assert found.frequency == pytest.approx(1.6 * swing / (2 * np.pi), rel=1e-3)


def test_a_rig_with_another_stiffness_swings_at_another_frequency(record):
    """Where the simulation is that of another rig, the rotor swings as it does there."""
    e = record.experiment
    stiffer = replace(e, rig=with_parameters(e.rig, {"support_stiffness": 1.1 * e.rig.support_stiffness}))
    _, rank = ringing_directions(record, e, driven_directions(record)[0])
    _, more = ringing_directions(record, stiffer, driven_directions(record)[0])
    assert rank.max() >= 1 and more.max() > rank.max() and more.sum() > rank.sum()
    names = ringing(record, nominal_loop(record), OUTPUTS, np.ones((2, 2, record.frequency.size)), stiffer)
    assert len(names) == 8  # sine and cosine of two poles along two axes
