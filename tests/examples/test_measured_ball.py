"""The script of the measured ball against a made-up ball whose gain and stiffness are known."""

import re
from pathlib import Path

import numpy as np
import pytest

from maglev_env.recordings.campaign import load_campaign

ROOT = Path(__file__).parents[2]
MASS, GRAVITY, STIFFNESS, GAP = 0.018, 9.80665, 50.0, 4e-3
GAIN = 0.9
BIAS = 2 * MASS * GRAVITY / GAIN


@pytest.fixture(autouse=True)
def on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "examples"))


def ball():
    """A ball that rings after each of three steps, with (ks + m w^2) gap = ki i exactly."""
    from measured_ball import Motion

    t = np.arange(3000) / 100.0
    gap, wanted = np.full(t.size, GAP), np.full(t.size, GAP)
    for at, size in ((5.0, 1e-3), (13.0, -5e-4), (21.0, 5e-4)):
        s, q = np.maximum(t - at, 0), 4.0
        wanted[t >= at] += size
        # Both terms begin smoothly, so that the second derivative by the spectrum is exact.
        smooth = 1 - np.exp(-q * s) * (1 + q * s + (q * s) ** 2 / 2)
        gap += size * (smooth + 40 * s**4 * np.exp(-2 * q * s) * np.sin(8 * np.pi * s))
    mirrored = np.concatenate([gap, gap[::-1]])
    w = 2 * np.pi * np.fft.rfftfreq(mirrored.size, 0.01)
    bend = np.fft.irfft(-(w**2) * np.fft.rfft(mirrored), mirrored.size)[: t.size]
    current = BIAS + (STIFFNESS * (gap - GAP) - MASS * bend) / GAIN
    return Motion("ball", 100.0, gap, current, wanted)


def test_rest_and_motion_give_the_gain_that_is_there():
    from measured_ball import BANDS, at_rest, gain_in_motion, rests

    one = ball()
    assert one.stepped
    gain, stiffness, _ = at_rest(list(rests(one)), MASS, GRAVITY, GAP)
    assert (gain, stiffness) == (pytest.approx(GAIN, rel=0.01), pytest.approx(STIFFNESS, rel=0.01))
    g = np.array(gain_in_motion(one, MASS, STIFFNESS))
    low = [k for k, (_, top) in enumerate(BANDS) if top <= 6.0]
    assert np.abs(g[low]) == pytest.approx(GAIN, rel=0.03)
    assert np.degrees(np.angle(g[low])) == pytest.approx(0, abs=2)


def test_the_campaign_and_the_page_are_complete(tmp_path):
    page = (ROOT / "docs" / "case-measured-ball.md").read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page)
    assert pictures and all((ROOT / "docs" / name).exists() for name in pictures)
    for name in ("rig.toml", "campaign.toml"):
        text = (ROOT / "examples" / "measured_ball" / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(text, encoding="utf-8")
        for file in re.findall(r'file = "(.*)"', text):
            (tmp_path / file).touch()
    campaign = load_campaign(tmp_path)
    assert campaign.rig.force_constant == pytest.approx(0.0327 * 5.2e-3 / 2)
    assert sorted(r.role for r in campaign.recordings) == ["fit", "fit", "holdout"]
