"""`maglev selfsense demodulate` as a user runs it, against closed forms and the linear model."""

import json
from functools import partial
from math import hypot, pi, sqrt

import numpy as np
import pytest
from command_line import maglev

from maglev_env.design.defaults import with_defaults
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from selfsense.linear import tracking

run = partial(maglev, "selfsense", "demodulate")
GAP, MOTION, SWING, HZ = 0.35e-3, 50e-6, 0.1, 100.0  # of the rig, and the command's defaults


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demodulate")
    text = run("--out", folder / "p.html", "--json", folder / "d.json")
    return text, json.loads((folder / "d.json").read_text()), (folder / "p.html").read_text()


def test_the_estimator_rejects_a_moving_duty_ten_times_better_than_the_demodulator(default):
    _, data, _ = default
    assert data["schema"] == "maglev-selfsense-demodulate/1" and data["rig"] == "hmb_free" and data["version"]
    varying = data["duty"]["varying"]
    assert varying["ideal_reading"]["ratio"] > 10
    # The rig's noise and bits cost the estimate a micrometre, and with it a third of that.
    assert 6 < varying["ratio"] < 8 and varying["estimated"]["rms"] == pytest.approx(1.5e-6, rel=0.1)
    assert data["sensor"]["acquisition"]["bits"] == 12 and data["sensor"]["acquisition"]["noise"] == 2e-3
    for case in (varying, varying["ideal_reading"]):
        assert case["ratio"] == pytest.approx(case["demodulated"]["rms"] / case["estimated"]["rms"])


def test_the_corruption_is_the_closed_form_and_what_the_path_adds(default):
    _, data, _ = default
    # The mean over a period of -(gap + motion sin) (2 swing cos)^2, and its rms.
    assert data["closed_form"]["bias"] == pytest.approx(-GAP * 2 * SWING**2, rel=1e-6)
    phase = np.linspace(0, 2 * pi, 10_001)[:-1]
    square = ((GAP + MOTION * np.sin(phase)) * (2 * SWING * np.cos(phase)) ** 2) ** 2
    assert data["closed_form"]["rms"] == pytest.approx(sqrt(square.mean()), rel=1e-4)
    found = data["duty"]["varying"]["ideal_reading"]["demodulated"]
    # The few samples per PWM period add up to 5 % of the gap; here they add a third of a percent.
    assert found["bias"] == pytest.approx(data["closed_form"]["bias"] - 1.1e-6, abs=0.2e-6)
    assert abs(data["duty"]["constant"]["demodulated"]["bias"]) < 0.05e-6
    assert 1.0 < data["path_factor"] < 1.05


def test_errors_and_lag_are_those_of_the_linear_model(default):
    _, data, _ = default
    response = complex(tracking(rig_sensors(with_defaults(load_rig("hmb_free")))[0], np.array([HZ]))[0])
    found = data["duty"]["constant"]["ideal_reading"]["estimated"]
    assert found["rms"] == pytest.approx(abs(1 - response) * MOTION / sqrt(2), rel=0.02)
    assert found["lag"] == pytest.approx(-np.degrees(np.angle(response)), rel=0.02)
    assert found["delay"] * 360 * HZ == pytest.approx(found["lag"])
    assert found["rms_without_lag"] < found["rms"] / 10
    assert data["duty"]["constant"]["demodulated"]["lag"] > data["duty"]["constant"]["estimated"]["lag"]


def test_what_current_such_a_duty_drives(default):
    _, data, _ = default
    reactance = 2 * pi * HZ * 4e-7 * pi * 90**2 * 39.27e-6 / (2 * GAP)
    assert data["current"]["inductive"] == pytest.approx(2 * SWING * 24 / reactance)
    assert data["current"]["with_resistance"] == pytest.approx(2 * SWING * 24 / hypot(reactance, 2.0))
    assert data["current"]["simulated"] == pytest.approx(data["current"]["with_resistance"], rel=0.01)


def test_console_and_page_say_the_answer_first_with_noise_and_bits(default):
    text, data, page = default
    ratio = f"{data['duty']['varying']['ideal_reading']['ratio']:.1f} times less"
    for words in (ratio, "12 bits over ±5 A, 2 mA rms noise", "demodulated", "1/2 ± 0.1"):
        assert words in text and words in page
    for words in ("eq. 6.20", "1.0134 times", "262.5 kHz", "closed form", "eq. 6.25", "hmb_free (hybrid_pair)"):
        assert words in page
    assert page.count('class="plotly-graph-div"') == 2
    assert "Seed" in page and page.index("times less") < page.index("<h2>")


def test_a_seed_gives_the_same_file_and_another_seed_other_noise(tmp_path):
    files = []
    for i, seed in enumerate((3, 3, 4)):
        own = tmp_path / str(i)  # a page links to the others of its folder
        own.mkdir()
        run("--out", own / "d.html", "--json", own / "d.json", "--seed", seed, "--frequency", 250)
        files.append((own / "d.json").read_text())
    assert files[0] == files[1] != files[2]
    assert (tmp_path / "0" / "d.html").read_text() == (tmp_path / "1" / "d.html").read_text()
    first, other = (json.loads(f)["duty"]["constant"]["estimated"]["rms"] for f in files[::2])
    assert first != other and first == pytest.approx(other, rel=0.1)


def test_the_page_lies_here_unless_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("--frequency", 500)
    assert [p.name for p in tmp_path.iterdir()] == ["selfsense-demodulate.html"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--frequency", "0"], "--frequency 0 Hz"),
        (["--frequency", "0.5"], "use 1 Hz or more"),
        (["--frequency", "2600"], "a tenth of the PWM frequency, 2500 Hz"),
        (["--frequency", "nan"], "--frequency nan Hz"),
        (["--amplitude", "0"], "--amplitude 0 m"),
        (["--amplitude", "3.5e-4"], "use up to 0.000343 m"),
        (["--amplitude", "nan"], "--amplitude nan m"),
        (["--duty-swing", "0"], "up to 0.45"),
        (["--duty-swing", "0.5"], "up to 0.45"),
        (["--duty-swing", "0.3"], "'current clipped'"),
    ],
)
def test_bad_input_ends_with_one_message_and_code_2(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = run(*arguments, code=2)
    assert words in text and text.startswith("maglev:") and not any(tmp_path.iterdir())
