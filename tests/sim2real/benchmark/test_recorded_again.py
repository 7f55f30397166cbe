"""Recordings of the benchmark that are made again as a diagnosis asks for them, and read as a campaign."""

import numpy as np
import pytest

from sim2real.blind.benchmark import promise
from sim2real.blind.benchmark.again import again
from sim2real.blind.benchmark.detect import Detector
from sim2real.blind.benchmark.drives import draw_drive
from sim2real.blind.benchmark.generate import Case, Made
from sim2real.blind.benchmark.promise import Tried, recordings_made, share_decided, try_both
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.blind.cases import Case as Sealed
from sim2real.recorded.records import read_records


@pytest.fixture(scope="module")
def made():
    """A stand that a multisine at the command drives, and noise, for a tenth of a second."""
    rng = np.random.default_rng(3)
    rig = draw_rig("stand", rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    drives = []
    while {(d.shape, d.at) for d in drives} < {("multisine", "current"), ("noise", "current")}:
        drives.append(draw_drive(("multisine", "noise")[len(drives) % 2], rig, False, 0.02, rng))
    chosen = {d.shape: d for d in drives if d.at == "current"}
    rows = [Recording(f"record{n}", "fit", controller, chosen[s]) for n, s in enumerate(("multisine", "noise"), 1)]
    truth = Truth(rig)
    case = Case(1, "stand", "no_force", "single", ("delay",))
    return Made(case, truth, rows, Detector(truth, rows, True, 1), {})


def read(made, folder, of, change):
    """The base as it was, and the new recording, as a campaign is read."""
    base = next(r for r in made.recordings if f"{r.name}.npz" == of)
    rows = [Recorded(base, True, simulate(made.truth, base, 1)), again(made, of, change, 1, 5)]
    write_campaign(folder / "c", made.truth.rig, "no_force", rows)
    return rows, read_records(folder / "c")[1]


def test_twice_the_amplitude_doubles_what_drives_and_what_answers(made, tmp_path):
    (old, new), (before, after) = read(made, tmp_path, "record1.npz", {"amplitude": 2.0})
    assert after.waves["current"] == pytest.approx(2 * before.waves["current"], rel=1e-3)
    assert np.std(new.values["displacement"]) == pytest.approx(2 * np.std(old.values["displacement"]), rel=0.1)


def test_an_offset_is_a_set_point_that_is_recorded_at_rest(made, tmp_path):
    offset = 0.1 * made.truth.rig.parameters["gap"]
    (_, new), (_, after) = read(made, tmp_path, "record1.npz", {"offset": offset})
    assert after.waves["reference"].mean() == pytest.approx(offset, rel=1e-3)
    period = new.values["displacement"][: new.recording.drive.wave.size // 6]
    last = new.values["displacement"][-period.size :]
    assert period.mean() == pytest.approx(last.mean(), abs=0.02 * offset)  # it was at rest there when it began


def test_other_gains_are_those_of_the_recording(made, tmp_path):
    (old, new), _ = read(made, tmp_path, "record2.npz", {"gains": [0.8, 1.3]})
    was, now = old.recording.controller.pid, new.recording.controller.pid
    assert [now[n] / was[n] for n in ("kp", "ki", "kd", "td")] == pytest.approx([0.8, 1.0, 1.3, 1.0])


def test_a_multisine_takes_lines_over(made, tmp_path):
    driven = made.recordings[0].drive.lines
    change = {"excitation": {"at": "force", "lines": list(driven[1::2]), "peak": 0.01}}
    _, (before, after) = read(made, tmp_path, "record1.npz", change)
    own, added = (set(after.lines[after.driven[at].any(axis=0)]) for at in ("current", "force"))
    assert own == set(driven[::2]) and added == set(driven[1::2])
    assert set(before.lines[before.driven["current"].any(axis=0)]) == set(driven)


def test_a_multisine_beside_noise_is_stored_with_it(made, tmp_path):
    change = {"excitation": {"at": "current", "frequencies": [20.0, 31.5], "peak": 0.01}}
    (old, new), (_, after) = read(made, tmp_path, "record2.npz", change)
    added = new.recording.drive.wave - old.recording.drive.wave
    assert np.abs(added).max() == pytest.approx(0.01)
    assert after.waves["current"].ravel() == pytest.approx(
        new.values["injection"].ravel(), abs=0.6 * made.truth.rig.counts["command"]
    )


def test_recordings_are_added_until_the_truth_alone_is_named(made, monkeypatch):
    """The stand-in for a diagnosis names the delay as soon as it sees a recording at twice the amplitude."""

    def diagnose(folder):
        named = (folder / "next2.npz").is_file()
        cause = ["delay"] if named else ["delay", "amplifier_lag"]
        which = [{"effects": [name], "probability": 1 / len(cause)} for name in cause]
        verdict = "explained" if named else "ambiguous"
        blocks, gap = {}, {"closed_fraction": 1.0}
        shown = {"schema": "maglev-diagnosis/1", "verdict": verdict, "cause": cause, "which": which}
        return {**shown, "where": {"blocks": blocks}, "gap": gap}

    monkeypatch.setattr(promise, "make", lambda case, seed: made)
    monkeypatch.setattr(promise, "plan", lambda count, seed: [made.case])
    case = Sealed("c0001", "single", "stand", "no_force", frozenset({"delay"}), 5.0, frozenset({0.0}), {})
    louder = {"what": "louder", "change": {"amplitude": 2.0}, "of": "record1.npz"}
    other = {"what": "other gains", "change": {"gains": [0.8, 1.3]}, "of": "record1.npz"}
    asked = {"proposals": [louder, other], "menu": [{**louder, "change": {"amplitude": 1000.0}}]}
    found = try_both(case, {"next_experiments": asked}, 5, 1, diagnose)
    assert found["proposed"] == Tried(("louder", "other gains"), ("ambiguous", "explained"), 2)
    assert found["random"] == Tried(("louder",), ("touchdown",), None)
    both = list(found.values())
    assert (share_decided(both, 1), share_decided(both, 2)) == (0.0, 0.5)
    assert [recordings_made(t) for t in both] == [2, 2]


def test_the_second_recording_is_the_one_that_the_diagnosis_with_the_first_asks_for(made, monkeypatch):
    """It repeats the new one, at other gains in place of what the first plan went on with."""
    gains = {"what": "other gains", "change": {"gains": [0.8, 1.3]}, "of": "next1.npz"}

    def diagnose(folder):
        done = (folder / "next2.npz").is_file()
        cause = ["delay"] if done else ["delay", "amplifier_lag"]
        which = [{"effects": [name], "probability": 1 / len(cause)} for name in cause]
        shown = {"schema": "maglev-diagnosis/1", "verdict": "explained" if done else "ambiguous", "cause": cause}
        asked = {"proposals": [gains], "menu": [gains]}
        return {**shown, "which": which, "where": {"blocks": {}}, "gap": {}, "next_experiments": asked}

    monkeypatch.setattr(promise, "make", lambda case, seed: made)
    monkeypatch.setattr(promise, "plan", lambda count, seed: [made.case])
    case = Sealed("c0001", "single", "stand", "no_force", frozenset({"delay"}), 5.0, frozenset({0.0}), {})
    louder = {"what": "louder", "change": {"amplitude": 2.0}, "of": "record1.npz"}
    moved = {"what": "elsewhere", "change": {"offset": 1e-5}, "of": "record1.npz"}
    asked = {"proposals": [louder, moved], "menu": [louder]}
    found = try_both(case, {"next_experiments": asked}, 5, 1, diagnose)
    assert found["proposed"] == Tried(("louder", "other gains"), ("ambiguous", "explained"), 2)
