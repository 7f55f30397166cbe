"""`maglev selfsense noise`: errors against a bound by hand, and what is said of coarse converters."""

import json
from functools import partial
from importlib.resources import files

import numpy as np
import pytest
from command_line import maglev

run = partial(maglev, "selfsense", "noise")


def rig_file(folder, table, noise="2e-3"):
    text = (files("maglev_env") / "rigs" / "hmb_free.toml").read_text()
    path = folder / "bench.toml"
    path.write_text(text.replace("current = 2e-3", f"current = {noise}") + f"\n[self_sensing]\n{table}\n")
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("noise")
    output = run("--out", folder / "n.html", "--json", folder / "n.json")
    return output, json.loads((folder / "n.json").read_text()), (folder / "n.html").read_text()


def by_hand(bits, noise, bandwidth):
    """Bound (m) of a triangle's height at a coil of 0.571 mH and 24 V, sampled at 262.5 kHz."""
    slope = 24.0 * 20e-6 / 0.571e-3 / 0.35e-3 / np.sqrt(12)  # of its rms by the gap, A/m
    sigma = np.hypot(noise, 10 / 2**bits / np.sqrt(12) if bits else 0.0)
    return sigma * np.sqrt(2 * bandwidth / 262.5e3) / slope


def test_the_bound_is_that_by_hand(made):
    _, data, _ = made
    assert data["schema"] == "maglev-selfsense-noise/1"
    assert len(data["points"]) == 7 * 7 - 1  # the ideal reading without noise has no bound
    for p in data["points"]:
        assert p["bound"] == pytest.approx(by_hand(p["bits"], p["noise"], data["noise_bandwidth"]), rel=0.06)
        assert p["ratio"] == pytest.approx(p["rms"] / p["bound"], rel=1e-9)


def test_the_rigs_own_reading(made):
    output, data, page = made
    own = data["own"]
    assert (own["bits"], own["noise"]) == (12, 2e-3)
    assert own["rms"] == pytest.approx(1.1e-6, rel=0.08)
    assert own["ratio"] == pytest.approx(data["forward_path_cost"], rel=0.06)
    text = "s own 12 bits over ±5 A, 2 mA rms noise, the gap errs by 1.1"
    assert text in output and text in page


def test_fine_converters_stay_at_the_cost_of_the_forward_path(made):
    _, data, _ = made
    fine = [p for p in data["points"] if p["bits"] in (0, 12, 16)]
    assert len(fine) == 20
    for p in fine:
        # A tenth of an ampere is a third of the ripple: no small noise any more.
        assert p["ratio"] == pytest.approx(data["forward_path_cost"], rel=0.08 if p["noise"] < 0.1 else 0.15)


def test_the_dissertations_rate_stands_beside_the_rigs(made):
    output, data, _ = made
    beside = data["dissertation_rate"]
    assert beside["rate"] == 250e3 and [p["bits"] for p in beside["points"]] == [4, 6, 8, 10, 12, 16]
    # Ten samples locked to the PWM see the same counts: 6 bits are far worse than with ten and a half.
    at_rig = next(p for p in data["points"] if (p["bits"], p["noise"]) == (6, 0.0))
    assert beside["points"][1]["rms"] > 2 * at_rig["rms"]
    assert "It nowhere exceeds twice the bound (most: 1." in output and "1.89 with 6 bits at 250 kHz" in output
    assert "With 6 bits and fewer a count is 19% of the ripple" in output


def test_a_narrow_estimator_exceeds_twice_the_bound_with_six_bits_at_250_kHz(tmp_path):
    """The same counts every period: an error that no average takes away, while the bound falls with the bandwidth."""
    rig = rig_file(tmp_path, "sample_rate = 250e3\nkp = 0.0008\nki = 16.0")
    output = run("--rig", rig, "--out", tmp_path / "n.html", "--json", tmp_path / "n.json")
    assert "The error exceeds twice the bound with 6 bits at 250 kHz (up to 3.9)." in output
    data = json.loads((tmp_path / "n.json").read_text())
    assert {p["bits"] for p in data["points"] if p["ratio"] > 2 and not p["lost"]} == {6}
    assert data["dissertation_rate"]["points"] == []


def test_a_supply_that_250_kHz_is_too_slow_for_has_no_such_column(tmp_path):
    rig = rig_file(tmp_path, "pwm_frequency = 150e3\nsample_rate = 1.5e6\nkp = 0.001\nki = 10.0")
    run("--rig", rig, "--out", tmp_path / "n.html", "--json", tmp_path / "n.json")
    assert json.loads((tmp_path / "n.json").read_text())["dissertation_rate"]["points"] == []


def test_an_ideal_reading(tmp_path):
    rig = rig_file(tmp_path, "adc_bits = 0", noise="0.0")
    output = run("--rig", rig, "--out", tmp_path / "n.html", "--json", tmp_path / "n.json")
    data = json.loads((tmp_path / "n.json").read_text())
    assert data["own"] is None
    assert data["record"]["error"] == data["record"]["quiet"]
    assert "read without noise and converter" in output


def test_where_the_ripple_is_small_the_gap_is_lost(tmp_path):
    output = run("--rig", "eframe", "--out", tmp_path / "n.html", "--json", tmp_path / "n.json")
    data = json.loads((tmp_path / "n.json").read_text())
    lost = {(p["bits"], p["noise"]) for p in data["points"] if p["lost"]}
    assert (6, 0.0) in lost and (12, 2e-3) not in lost
    assert " lost " in output
    assert "runs into the ends of its range" in (tmp_path / "n.html").read_text()


def test_the_record_follows_the_seed(made, tmp_path):
    errors = []
    for seed in (0, 1):
        run("--seed", seed, "--out", tmp_path / "n.html", "--json", tmp_path / "n.json")
        record = json.loads((tmp_path / "n.json").read_text())["record"]
        errors.append(np.array(record["error"]) - record["quiet"])
    assert errors[0].std() == pytest.approx(errors[1].std(), rel=0.2) == pytest.approx(1.1e-6, rel=0.2)
    assert np.abs(errors[0] - errors[1]).max() > 1e-6
    first = made[1]["record"]
    np.testing.assert_array_equal(errors[0], np.array(first["error"]) - first["quiet"])
