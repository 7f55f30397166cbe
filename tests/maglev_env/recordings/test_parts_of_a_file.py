"""Two recordings in one file: two tables of a campaign, and no level of what lies between them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import parse_campaign
from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.recordings.files import write_npz
from maglev_env.recordings.guess.parts import parts_of
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.longest_stretch import without_gaps
from maglev_env.recordings.recording import read_recording
from maglev_env.redundancy.rules import examine

RATE, FIRST, LAST = 1000.0, 3000, 5000
N = FIRST + LAST


def write(folder, gap):
    """A file whose time stands still for `gap` seconds behind its first 3000 samples."""
    time = np.arange(N) / RATE
    time[FIRST:] += gap
    force = np.sin(2 * np.pi * 10 * np.arange(N) / RATE)
    moved = 20 + lfilter([0.02], [1, -0.98], force + 0.1 * np.random.default_rng(7).standard_normal(N))
    write_npz(folder / "r.npz", {"t_s": time, "x_um": moved, "F_N": force})
    return guess_recording(folder / "r.npz")


@pytest.mark.parametrize(("gap", "parts"), [(36.0, [(0, FIRST), (FIRST, LAST)]), (0.0, [None]), (0.002, [None])])
def test_each_stretch_is_a_recording(tmp_path, gap, parts):
    found = parts_of(write(tmp_path, gap), tmp_path)
    assert [part.part for part in found] == parts
    assert all(part.file == "r.npz" and part.rate.value == RATE for part in found)
    assert all(len(part.excitations) == 1 and part.excitations[0]["at"] == "force" for part in found)


def test_levels_are_those_of_the_longest_stretch(tmp_path):
    table = write(tmp_path, 36.0).table()
    campaign = parse_campaign(tmp_path, {"schema": SCHEMA, "recording": [table]})
    (spec,) = campaign.recordings
    dataset = read_recording(campaign, spec, alarmed=True)
    assert alarms_of(dataset)[0].stretch == [FIRST, LAST]
    cut, longest = without_gaps(campaign, spec, dataset)
    assert (cut.start, cut.samples) == (FIRST, LAST) and longest.sizes["time"] == LAST
    assert not alarms_of(longest)
    assert without_gaps(campaign, cut, longest) == (cut, longest)


def test_recordings_of_one_file_have_names_of_their_own(tmp_path):
    """They shared the file's name: no finding told of which it was, and results by name held only the last of them."""
    table = write(tmp_path, 36.0).table()
    names = [(0, FIRST), (FIRST, LAST - 1), (FIRST, LAST)]
    tables = [{**table, "start": start, "samples": samples} for start, samples in names]
    (tmp_path / "s.npz").write_bytes((tmp_path / "r.npz").read_bytes())

    def read(*tables):
        return parse_campaign(tmp_path, {"schema": SCHEMA, "recording": [*tables]})

    assert [spec.name for spec in read(tables[1], {**table, "file": "s.npz"}).recordings] == ["r.npz", "s.npz"]
    both = read(*tables[:2])
    assert [spec.name for spec in both.recordings] == ["r.npz from sample 0", "r.npz from sample 3000"]
    assert {spec.file for spec in both.recordings} == {"r.npz"}
    found = {f.recording for f in examine(both)}
    assert found and found <= {spec.name for spec in both.recordings}
    alike = [spec.name for spec in read(*tables).recordings]
    assert alike[1:] == ["r.npz from sample 3000 (recording 2)", "r.npz from sample 3000 (recording 3)"]
