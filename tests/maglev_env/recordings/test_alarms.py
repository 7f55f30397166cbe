"""Alarms stay silent on sound records of many kinds, and find what was done to them, with the time it begins."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from maglev_env.recordings.alarms.alarm import alarms_of, alarms_text
from maglev_env.recordings.alarms.clock import clock_alarms
from maglev_env.recordings.alarms.lost_levitation import lost_levitation
from maglev_env.recordings.alarms.rail import touched_rail
from maglev_env.recordings.alarms.rules import find_alarms
from maglev_env.recordings.formats.time_stamps import check_clock
from maglev_env.recordings.masking import clipped_samples
from maglev_env.rig.rig_file import load_rig

RATE, SAMPLES = 500.0, 6000
KINDS = ("hover", "steps", "sine", "chirp", "noise", "burst and rest", "slow steps")


def references(kind, count, rng):
    """Wanted displacement and injected force per mass, each (samples, count)."""
    t = np.arange(SAMPLES)[:, None] / RATE
    nothing, size = np.zeros((SAMPLES, count)), 1e-3 * np.exp(rng.uniform(-1, 1, count))
    if kind == "steps":
        levels = rng.choice([-1, 0, 0.5, 1], (6, count))
        return size * np.repeat(levels, SAMPLES // 6, axis=0), nothing
    if kind == "slow steps":
        ramp = np.clip(np.interp(np.arange(SAMPLES), [0, 1500, 2500, 6000], [0, 0, 1, 1]), 0, 1)[:, None]
        return ramp * size, nothing
    if kind == "sine":
        return size * np.sin(2 * np.pi * rng.uniform(0.1, 5, count) * t), nothing
    if kind == "chirp":
        return size * np.sin(2 * np.pi * (0.1 + 0.2 * t) * t), nothing
    if kind == "noise":
        return nothing, 3 * rng.standard_normal((SAMPLES, count)).cumsum(axis=0) * 0.05
    if kind == "burst and rest":
        return nothing, np.where((t > 2) & (t < 5), 5 * rng.standard_normal((SAMPLES, count)), 0)
    return nothing, nothing


def closed_loops(kind, count, seed):
    """Unstable rotors under PID control with coarse converters and noise of any size, as datasets."""
    rng = np.random.default_rng(seed)
    wanted, push = references(kind, count, rng)
    pole = rng.uniform(10, 30, count)
    speed, damping = 2.5 * pole, rng.uniform(0.4, 0.9, count)
    kp, kd, ki = speed**2 + pole**2, 2 * damping * speed, 0.2 * speed**3
    step = 20e-3 / 2 ** rng.choice([10, 12, 14, 16], count)
    noise = step * np.exp(rng.uniform(-1, 2, count))  # a reading that never leaves one step looks stuck, and is as bad
    limit = rng.uniform(1.0, 4.0, count) * kp * 1e-3 + 8
    y, v, total, before = (np.zeros(count) for _ in range(4))
    rows = {"displacement": [], "command": [], "current": []}
    for k in range(SAMPLES):
        reading = np.round((y + noise * rng.standard_normal(count)) / step) * step
        error = wanted[k] - reading
        total = total + error / RATE
        command = np.clip(kp * error + ki * total - kd * (reading - before) * RATE + push[k], -limit, limit)
        before = reading
        for _ in range(4):
            v = v + (pole**2 * y + command) / (4 * RATE)
            y = y + v / (4 * RATE)
        current = np.round((command + 1e-3 * limit * rng.standard_normal(count)) / (limit / 512)) * (limit / 512)
        for name, value in zip(rows, (reading, command, current), strict=True):
            rows[name].append(value)
    arrays = {name: np.array(values) for name, values in rows.items()}
    sound = np.abs(arrays["displacement"]).max(axis=0) < 20e-3
    return [dataset({n: a[:, i] for n, a in arrays.items()}) for i in np.flatnonzero(sound)]


def dataset(channels, rate=RATE):
    return xr.Dataset({n: ("time", v) for n, v in channels.items()}, attrs={"sample_rate": rate})


def rails(record):
    return [a for n in record for a in touched_rail(str(n), "c", *[record[n].values] * 2, RATE)[:1] if a]


def test_sound_loops_raise_no_alarm():
    records = [r for kind in KINDS for r in closed_loops(kind, 60, seed=5)]
    assert len(records) > 300
    assert not any(lost_levitation(r) for r in records)
    # A command that is at its limit for a while is a rail, and said; nothing else is wrong with these records.
    alarms = [[a for a in (*find_alarms(r), *rails(r)) if (a.code, a.channel) != ("rail", "command")] for r in records]
    assert sum(map(bool, alarms)) <= 0.01 * len(records), [a.sentence for found in alarms for a in found]


@pytest.fixture(scope="module")
def loops():
    return [r for kind in KINDS[1:5] for r in closed_loops(kind, 15, seed=9)]


def test_a_rotor_at_the_clearance_of_its_rig_is_lost_though_its_command_is_within_limits(loops):
    rng = np.random.default_rng(7)
    rig = replace(load_rig("hmb_axial"), clearance=20e-3, gap=25e-3)
    record = loops[0]
    y = record["displacement"].values.copy()
    bounces = 20e-3 * (1 - 0.2 * (rng.random(1600) < 0.4)) + 2e-5 * rng.standard_normal(1600)
    y[2000:3600], y[3620:4000], y[5000:5500] = bounces, -20e-3, 20e-3
    (alarm,) = find_alarms(changed(record, displacement=y), 100, rig)
    assert alarm.code == "lost levitation" and "lost from 4 to 8 s, 10 to 11 s (41.7%" in alarm.sentence
    assert "start = 100, samples = 2000" in alarm.sentence
    lying = changed(record, displacement=-20e-3 + 2e-5 * rng.standard_normal(SAMPLES))
    assert "lost from 0 to 12 s (100.0% of the record)" in find_alarms(lying, 0, rig)[0].sentence
    assert not find_alarms(record, 0, rig)


def test_a_reading_at_its_end_while_the_integrator_unwinds_slowly_is_a_loss(loops):
    record = loops[0]
    y, u = record["displacement"].values.copy(), record["command"].values.copy()
    y[2000:2400], u[2000:2400] = y.min(), u.min() + np.ptp(u) * np.linspace(0.4, 0.6, 400)
    (alarm,) = find_alarms(changed(record, displacement=y, command=u))
    assert "levitation is lost from 4 to 4.8 s" in alarm.sentence


def test_the_cut_of_a_jittered_recording_counts_rows_of_the_file():
    rng = np.random.default_rng(8)
    y, u = rng.standard_normal((2, 3000)) * [[1e-3], [1.0]]
    y[1000:], u[1000:] = 15e-3, 9.0
    rows = np.round(np.arange(3000) * 0.99).astype(int)
    record = dataset({"displacement": y, "command": u}).assign_coords(row=("time", rows))
    assert "start = 5, samples = 990;" in find_alarms(record, 5)[0].sentence + ";"


def changed(record, **values):
    return record.assign({n: ("time", v) for n, v in values.items()})


def test_a_rotor_that_falls_is_found_with_its_time(loops):
    rng, found, late = np.random.default_rng(1), 0, []
    for record in loops:
        at, length = int(rng.integers(1000, 3000)), int(rng.integers(100, 2000))
        y, u = record["displacement"].values.copy(), record["command"].values.copy()
        y[at : at + length] = 20e-3 + 2e-5 * rng.standard_normal(length)
        u[at : at + length] = -1.2 * np.abs(u).max()
        alarm = next(iter(find_alarms(changed(record, displacement=y, command=u), start=7)), None)
        found += alarm is not None and alarm.code == "lost levitation" and alarm.severity == "refuse"
        if alarm:
            late.append(alarm.time - at / RATE)
            assert "use the longest sound stretch: start = " in alarm.sentence
    assert found >= 0.95 * len(loops) and np.abs(late).max() < 0.05


def test_a_rotor_that_rests_at_a_stop_while_the_integrator_unwinds_is_lost(loops):
    record = loops[0]
    y, u = record["displacement"].values.copy(), record["command"].values.copy()
    y[2000:2400], u[2000:2400] = -15e-3, np.linspace(u.min(), u.max(), 400)
    (alarm,) = find_alarms(changed(record, displacement=y, command=u))
    assert alarm.code == "lost levitation" and abs(alarm.time - 4.0) < 0.02


def test_a_stuck_reading_is_found_with_its_time(loops):
    rng, found, exact = np.random.default_rng(2), 0, 0
    moving = [r for r in loops if np.unique(r["displacement"].values).size > 200]
    for record in moving:
        at, length = int(rng.integers(1000, 3000)), int(rng.integers(300, 1500))
        y = record["displacement"].values.copy()
        y[at : at + length] = y[at]
        alarms = [a for a in find_alarms(changed(record, displacement=y)) if a.code == "stuck reading"]
        found += bool(alarms)
        exact += bool(alarms) and abs(alarms[0].time - at / RATE) < 0.02
    assert len(moving) > 20 and found >= 0.9 * len(moving) and exact >= 0.95 * found


def test_a_channel_that_never_moves_is_stuck_while_others_do(loops):
    record = changed(loops[0], current=np.full(SAMPLES, 1.5))
    (alarm,) = find_alarms(record)
    assert (
        alarm.code == "stuck reading" and "current is 1.5 A in every sample while displacement moves" in alarm.sentence
    )


def test_samples_stored_twice_are_found():
    rng = np.random.default_rng(3)
    record = dataset({"displacement": 1e-4 * rng.standard_normal(5000), "command": rng.standard_normal(5000)})
    rows = np.insert(np.arange(5000), np.arange(100, 4900, 200), np.arange(99, 4899, 200))
    (alarm,) = find_alarms(record.isel(time=rows), start=10)
    assert alarm.code == "samples" and alarm.severity == "warning"
    assert "24 samples repeat the one before" in alarm.sentence and "(sample 110)" in alarm.sentence
    assert not find_alarms(record)


def test_coarse_readings_that_turn_round_together_in_every_period_are_not_stored_twice():
    """Near the turning points of a slow excitation all coarse channels repeat, in each of 15 periods alike."""
    rng, t = np.random.default_rng(5), np.arange(1000) / 1000
    current = np.cos(2 * np.pi * t)
    coarse = {
        name: np.rint(4000 * np.tile(one, 15) / np.ptp(one) + 0.1 * rng.standard_normal(15_000)) / 4000
        for name, one in (("displacement", -0.9 * current), ("current", current))
    }
    equal = (np.diff(coarse["displacement"]) == 0) & (np.diff(coarse["current"]) == 0)
    assert equal.mean() > 0.01  # of which the rule would refuse the record
    record = dataset(coarse)
    assert not find_alarms(record)
    rows = np.insert(np.arange(15_000), np.arange(100, 14_900, 50), np.arange(99, 14_899, 50))
    (alarm,) = find_alarms(record.isel(time=rows))
    doubled = int(re.match(r"\d+", alarm.sentence)[0])
    assert alarm.code == "samples" and 260 <= doubled <= 296, "most of 296; some lie at turning points"


@pytest.mark.parametrize(("level", "severity"), [(2.4, "warning"), (1.0, "refuse")])
def test_rails_are_masked_or_refused_by_their_share(level, severity):
    values = np.random.default_rng(4).standard_normal(20_000)
    clipped = np.repeat(np.minimum(values, level), 4)
    alarm, at = touched_rail("current", "i", clipped, clipped, RATE, start=3)
    assert alarm.severity == severity and (at == (clipped == level)).all()
    first = int(np.argmax(at))
    assert alarm.time == first / RATE and f"(sample {first + 3})" in alarm.sentence
    assert not clipped_samples(values).any()


T = np.arange(2000) / 100


@pytest.mark.parametrize(
    ("time", "words", "severity"),
    [
        (np.delete(T, [700, 701, 702]), "3 samples are missing after 6.99 s (sample 699)", "warning"),
        (np.delete(T, np.arange(700, 800)), "100 samples are missing after 6.99 s", "refuse"),
        (np.insert(T, 500, T[500]), "1 time stamps repeat, the first at 5.01 s (sample 501)", "warning"),
        (np.concatenate([T[:900], T[:900] + 1]), "time runs backward after 8.99 s (sample 899)", "refuse"),
    ],
)
def test_time_stamps_tell_of_missing_and_double_samples(time, words, severity):
    alarms = clock_alarms(check_clock(time, 100.0), 100.0)
    assert words in alarms[0].sentence and alarms[0].severity == severity


def test_alarms_travel_with_a_dataset(loops):
    alarms = find_alarms(changed(loops[0], current=np.full(SAMPLES, 1.5)))
    record = loops[0].assign_attrs(alarms=alarms_text(alarms))
    assert alarms_of(record) == alarms and json.loads(record.attrs["alarms"])[0]["code"] == "stuck reading"
    assert alarms_of(loops[0]) == ()


def test_a_displacement_that_is_counted_from_another_place_has_not_fallen():
    rig = load_rig("hmb_free")
    rng = np.random.default_rng(3)
    time = {"time": np.arange(SAMPLES) / RATE}
    y, i = 0.1 * rig.clearance * rng.standard_normal(SAMPLES), rng.standard_normal(SAMPLES)

    def alarms(offset):
        channels = {"displacement": ("time", y + offset), "current": ("time", i)}
        return lost_levitation(xr.Dataset(channels, time, {"sample_rate": RATE}), rig=rig)

    assert not alarms(0.0)
    (found,) = alarms(18e-3)
    assert found.severity == "refuse" and "state its offset" in found.sentence and "lost" not in found.sentence
