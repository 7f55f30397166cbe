"""A recording without its command is under other gains what it would be if these were stated."""

import numpy as np
import pytest
from bench_loop import KP, Bench, excitation, write_campaign

from maglev_env.loop.gains import with_gains
from sim2real.recorded.drive.other_gains import under_gains
from sim2real.recorded.records import read_records


@pytest.mark.parametrize("kind", ["noise", "steps"])
def test_other_gains_change_the_record_as_stating_them_does(tmp_path, kind):
    write_campaign(tmp_path, Bench(), {kind: "fit"}, 0.5, 0)
    driven = dict(zip(("injection", "reference"), excitation(kind, 0.5, np.random.default_rng(0)), strict=True))
    with np.load(tmp_path / f"{kind}.npz") as file:
        np.savez(tmp_path / f"{kind}.npz", **{**file, **driven})
    toml, (added,) = tmp_path / "campaign.toml", [name for name, wave in driven.items() if np.ptp(wave)]
    text = toml.read_text().replace('command = { from = "command" }', f'{added} = {{ from = "{added}" }}')
    toml.write_text(text)
    _, (stated,) = read_records(tmp_path)
    assert stated.source is None
    toml.write_text(text.replace(f"kp = {KP},", f"kp = {0.9 * KP},"))
    _, (other,) = read_records(tmp_path)
    own = under_gains(stated, with_gains(stated.experiment.gains, kp=0.9 * KP))
    assert own.experiment == other.experiment
    assert np.ptp(stated.command - other.command) > 0.01 * np.ptp(stated.command)
    for name in ("command", "added"):
        np.testing.assert_allclose(getattr(own, name), getattr(other, name), rtol=0, atol=1e-12)
    for place, wave in own.waves.items():
        np.testing.assert_array_equal(wave, other.waves[place])
