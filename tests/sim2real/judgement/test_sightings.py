"""Tones of recordings without a period, as the opened loop of a rig that was found shows them."""

import pytest
from bench_loop import Bench, write_campaign

from sim2real.compared.open_tones import with_tones
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import Point
from sim2real.judgement.sightings import FOREIGN, sightings
from sim2real.recorded.records import read_records

TONE = 2e-6  # m, of the probe, at 61.7 Hz


def test_the_size_of_a_tone_is_that_of_the_rig_found(tmp_path):
    """What the probe reads beside the displacement is as large as it is where the loop is opened at the true rig. At
    the nominal one, whose magnets pull more, it would be two thirds of that."""
    folder = write_campaign(tmp_path, Bench(stiffness=-0.4, tone=TONE), {"noise": "fit"}, 1.0, 0)
    _, (record,) = read_records(folder)
    found = Point({"negative_stiffness": {"change": -0.4}}, {})
    (seen,) = sightings(assemble([with_tones(record, found)], near=found), found)
    assert seen.family == FOREIGN and seen.frequency == pytest.approx(61.7, abs=0.1)
    assert seen.size == pytest.approx(TONE, rel=0.03)
