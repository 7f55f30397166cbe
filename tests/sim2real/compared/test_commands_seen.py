"""Lost commands in the current: seen where they are, and never in a lag, a delay, a limit or noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign
from scipy.stats import binom, norm

from sim2real.compared import commands_seen
from sim2real.compared.commands_seen import (
    FEWEST,
    LEAST,
    LOST,
    UNSURE,
    WITHIN,
    _Looked,
    _looked,
    looked_at,
    none_lost,
    runs_in_words,
    seen_lost,
    share_lost,
)
from sim2real.recorded.records import read_records
from sim2real.search.hypotheses import Hypothesis

RATE, SAMPLES, TIME = 2000.0, 4000, 8e-4
KEEPS = np.exp(-1 / RATE / TIME)


def command(rng):
    time = np.arange(SAMPLES) / RATE
    return 0.3 * np.sin(2 * np.pi * 7 * time**1.5) + 0.02 * rng.standard_normal(SAMPLES)


def amplified(sent, rng, noise):
    current, i = np.empty(SAMPLES), 0.0
    for k, u in enumerate(sent):
        current[k] = i
        i = KEEPS * i + (1 - KEEPS) * u
    return current + noise * rng.standard_normal(SAMPLES)


def with_lost(u, lost, rng):
    sent, last = np.empty_like(u), u[0]
    for k, now in enumerate(u):
        last = last if rng.random() < lost else now
        sent[k] = last
    return sent


@pytest.mark.parametrize("lost", [0.06, 0.25])
@pytest.mark.parametrize("noise", [2e-4, 1e-3])
@pytest.mark.parametrize("drive", ["chirp", "multisine"])
def test_what_is_lost_is_seen(lost, noise, drive):
    rng = np.random.default_rng(3)
    u = {"chirp": command, "multisine": multisine}[drive](rng)
    own = _looked(amplified(with_lost(u, lost, rng), rng, noise), u)
    assert own.likelier > LEAST
    sd = np.hypot(UNSURE * lost, np.sqrt(lost * (1 - lost) / own.told))
    assert abs(own.lost / own.told - lost) < WITHIN * sd


def test_no_hypothesis_loses_more_commands_than_are_seen_lost(monkeypatch):
    """On average a delay is as good as more of them."""
    looked = _Looked(100.0, 130, 1000)
    monkeypatch.setattr(commands_seen, "looked_at", lambda problem: [[looked], [_Looked(3.0, 400, 800)]])
    low, high = share_lost(None)
    assert 0.09 < low < 0.11 and 0.15 < high < 0.17
    h = Hypothesis((), {}, seen={LOST: (low, high)}).instead("delay", LOST)
    u = np.array([c.at({"time": 3e-5, "probability": 0.3}[c.parameter]) for c in h.coordinates])
    assert h.point(h.bounded(u)).effects[LOST]["probability"] == pytest.approx(high)
    monkeypatch.setattr(commands_seen, "looked_at", lambda problem: [[_Looked(3.0, 400, 800)]])
    assert share_lost(None) is None


@pytest.mark.parametrize("lost", [0, 1, 4, 200])
def test_a_small_count_has_the_ends_of_its_binomial_distribution(monkeypatch, lost):
    """Four of 4466 had "at most 9.0", of which four or fewer come in 5.5 % of cases, and none had no end at all."""
    monkeypatch.setattr(commands_seen, "looked_at", lambda problem: [[_Looked(100.0, lost, 4466)]])
    monkeypatch.setattr(commands_seen, "UNSURE", 0.0)
    low, high = share_lost(None)
    beyond = norm.cdf(-WITHIN)
    assert binom.cdf(lost, 4466, high) == pytest.approx(beyond)
    assert low == 0.0 if not lost else binom.sf(lost - 1, 4466, low) == pytest.approx(beyond)


def steps(rng):
    """Set-point kicks with a little noise."""
    levels = np.repeat(rng.uniform(-0.3, 0.3, SAMPLES // 200), 200)
    kicks = np.convolve(np.diff(levels, prepend=0.0), 5 * np.exp(-np.arange(30) / 6))[:SAMPLES]
    return levels + kicks + 0.003 * rng.standard_normal(SAMPLES)


def multisine(rng):
    at = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    return sum(0.05 * np.cos(n * at + rng.uniform(0, 6)) for n in range(3, 60, 2)) + 2e-3 * rng.standard_normal(SAMPLES)


@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-3, 0.1])
@pytest.mark.parametrize("drive", [command, steps, multisine])
@pytest.mark.parametrize(
    "kind", ["nothing", "delay", "later", "lag", "limit", "soft limit", "noisy command", "dead band"]
)
def test_nothing_else_seems_lost(kind, drive, noise):
    rng = np.random.default_rng(4)
    u = drive(rng)
    most = 0.7 * np.abs(u).max()
    sent = {
        "later": np.concatenate([u[:4], u[:-4]]),
        "soft limit": most * np.tanh(u / most),
        "nothing": u,
        "delay": 0.6 * u + 0.4 * np.concatenate([u[:1], u[:-1]]),
        "lag": np.convolve(u, 0.5 ** np.arange(1, 12))[:SAMPLES],
        "limit": np.clip(u, -most, most),
        "noisy command": u + 0.02 * rng.standard_normal(SAMPLES),
        "dead band": u - 0.01 * np.tanh(u / 0.01),
    }[kind]
    assert _looked(amplified(sent, rng, noise), u).likelier < LEAST


def test_a_current_or_a_command_that_stands_still_shows_nothing():
    rng = np.random.default_rng(5)
    assert _looked(np.zeros(SAMPLES), command(rng)).likelier == _looked(command(rng), np.zeros(SAMPLES)).likelier == 0.0
    assert _looked(command(rng)[:50], command(rng)[:50]).likelier == 0.0


def stalled(u, length, apart):
    """Commands of which the last one stays for so many control samples, every so often."""
    frozen = np.arange(u.size) % apart < length
    return np.array([u[k - k % apart] if frozen[k] else u[k] for k in range(u.size)])


@pytest.mark.parametrize(("length", "apart"), [(8, 237), (16, 413)])
def test_a_controller_that_stalls_loses_commands_in_turn(length, apart):
    rng = np.random.default_rng(6)
    u = np.tile(multisine(rng), 3)[:SAMPLES]
    own = _looked(amplified(stalled(u, length, apart), rng, 2e-4), u)
    assert own.likelier == 0.0 and own.lost == 0
    assert own.runs[0] == pytest.approx(length, abs=1) and own.runs[1] == pytest.approx(apart, abs=1)
    for sent in (u, with_lost(u, 0.1, rng)):
        assert _looked(amplified(sent, rng, 2e-4), u).runs is None


def test_a_log_of_what_was_sent_does_not_tell_that_nothing_was_lost():
    rng = np.random.default_rng(7)
    u = multisine(rng)
    sent = with_lost(u, 0.1, rng)
    assert _looked(amplified(u, rng, 2e-4), u).told > FEWEST
    assert _looked(amplified(sent, rng, 2e-4), sent).told == 0
    coarse = 0.02 * np.round(u / 0.02)  # of a converter, whose steps repeat a slow command
    lossy = _looked(amplified(with_lost(coarse, 0.1, rng), rng, 2e-4), coarse)
    assert np.mean(np.diff(coarse) == 0) > 0.05 and lossy.likelier > LEAST and lossy.told > FEWEST


@pytest.mark.slow
def test_recordings_with_periods_tell_lost_commands_too(tmp_path):
    rng = np.random.default_rng(8)
    _, records = read_records(campaign(tmp_path / "c", names=("base", "holdout")))
    rate, (command, *_) = records[0].nominal.control_rate, records[0].series["command"]
    keeps = np.exp(-1 / rate / records[0].nominal.amplifier_time_constant)

    def problem(sent):
        current, i = np.empty(sent.size), sent[0]
        for k, u in enumerate(sent):
            current[k] = i
            i = keeps * i + (1 - keeps) * u
        current += 1e-4 * np.std(current) * rng.standard_normal(sent.size)
        series = {**records[0].series, "current": current[None]}
        return SimpleNamespace(parts=[SimpleNamespace(record=replace(records[0], series=series))])

    sound, lossy, stalls = problem(command), problem(with_lost(command, 0.1, rng)), problem(stalled(command, 8, 237))
    looked = {one: looked_at(own) for one, own in (("sound", sound), ("lossy", lossy), ("stalls", stalls))}
    assert seen_lost(looked["sound"]) == seen_lost(looked["stalls"]) == 0.0 and seen_lost(looked["lossy"]) > LEAST
    assert none_lost(looked["sound"]) and none_lost(looked["stalls"]) and not none_lost(looked["lossy"])
    low, high = share_lost(lossy)
    assert low < 0.1 < high < 0.15 and share_lost(sound) is None
    assert runs_in_words(sound, looked["sound"]) == runs_in_words(lossy, looked["lossy"]) == []
    (said,) = runs_in_words(stalls, looked["stalls"])
    assert said.startswith("base") and "does the controller stall?" in said
    every_other = replace(records[0], experiment=replace(records[0].experiment, sample_rate=rate / 2))
    assert not none_lost(looked_at(SimpleNamespace(parts=[SimpleNamespace(record=every_other)])))
