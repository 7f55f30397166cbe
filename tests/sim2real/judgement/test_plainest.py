"""Recordings are asked whether they agree about as few parameters as explain them."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement.evidence import _plainest


@pytest.mark.parametrize(
    ("cost", "at"),
    [
        ([100.0, 95.0, 96.0], 0),  # what is not there saves as much as noise does
        ([200.0, 95.0, 94.0], 1),
        ([200.0, 95.0, 60.0], 2),
        ([np.inf, np.inf, np.inf], 0),
    ],
)
def test_what_saves_no_more_than_noise_is_left_out(cost, at):
    candidates = [SimpleNamespace(effects=names) for names in ((), ("damping",), ("damping", "support_resonance"))]
    assert _plainest(candidates, np.array(cost)) == at


@pytest.mark.parametrize(("seen", "at"), [(0.0, 0), (1000.0, 1)])
def test_commands_that_were_seen_to_be_lost_have_one_explanation(seen, at):
    candidates = [SimpleNamespace(effects=names) for names in (("amplifier_lag",), ("dropped_samples",))]
    assert _plainest(candidates, np.array([95.0, 130.0]), seen) == at
