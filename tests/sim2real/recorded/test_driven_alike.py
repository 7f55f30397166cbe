"""Axes that move alike in every recording, which tell nothing of what couples them."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.recorded.driven_alike import driven_alike_in_words

RNG = np.random.default_rng(0)
WAVE, OTHER = RNG.standard_normal((2, 4000))


def recording(x, y):
    noise = 0.02 * RNG.standard_normal((2, x.size))
    return SimpleNamespace(axes=2, series={"displacement": np.stack([x, y]) + noise})


@pytest.mark.parametrize(
    ("recordings", "said"),
    [
        ([recording(WAVE, WAVE), recording(OTHER, 1.02 * OTHER)], True),
        ([recording(WAVE, WAVE), recording(OTHER, -OTHER)], False),  # a force across the axes changes its sign
        ([recording(WAVE, WAVE), recording(WAVE, 0.0 * WAVE)], False),
        ([recording(WAVE, OTHER)], False),
        ([SimpleNamespace(axes=1, series={"displacement": WAVE[None]})], False),
    ],
)
def test_only_motion_that_is_alike_in_all_recordings_is_said(recordings, said):
    found = driven_alike_in_words(recordings)
    assert len(found) == said and all("drive one axis alone" in words for words in found)
