"""A measured ball below a coil: what it says at rest, and what it says as it moves (docs/case-measured-ball.md).

The recordings are not part of this repository: put them beside measured_ball/campaign.toml.

    python examples/measured_ball.py examples/measured_ball --out measured_ball.png
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from maglev_env.loop.magnets.kinds import geometric_law
from maglev_env.recordings.campaign import Campaign, RecordingSpec, load_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig import Rig

SETTLED, SHORTEST = 3.0, 1.0  # s after a step until the ball rests, and of rest that count
BEFORE, AFTER = 0.2, 4.0  # s around a step that are transformed
BANDS = ((0.1, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0), (5.0, 6.0), (6.0, 7.0), (7.0, 8.0),
         (8.0, 9.0), (9.0, 10.0), (10.0, 12.0))  # fmt: skip
LINES = 1024


@dataclass(frozen=True)
class Motion:
    """One recording in SI: gap (m), total current (A) and wanted gap (m), all (samples,)."""

    name: str
    rate: float
    gap: np.ndarray
    current: np.ndarray
    wanted: np.ndarray

    @property
    def steps(self) -> np.ndarray:
        """First samples of new set-points."""
        return np.flatnonzero(np.diff(self.wanted)) + 1

    @property
    def stepped(self) -> bool:
        """Whether the set-point rests between its changes."""
        return 0 < self.steps.size < 20


def motion(campaign: Campaign, spec: RecordingSpec) -> Motion:
    """A recording of a campaign whose current is stated as the total one."""
    rig, data = campaign.rig, read_recording(campaign, spec)
    position, wanted = data["displacement"].values, data["reference"].values
    current = data["current"].values + geometric_law(rig).bias_current
    return Motion(Path(spec.file).stem.partition("_")[0], spec.sample_rate, rig.gap - position, current,
                  rig.gap - wanted)  # fmt: skip


def rests(one: Motion) -> Iterator[tuple[float, float]]:
    """Mean gap (m) and current (A, root mean square, as it pulls) wherever the ball rests at a set-point."""
    edges = [0, *one.steps, one.gap.size]
    for first, last in pairwise(edges):
        part = slice(first + round(SETTLED * one.rate), last)
        if last - part.start >= SHORTEST * one.rate:
            yield float(one.gap[part].mean()), float(np.sqrt(np.mean(one.current[part] ** 2)))


def gain_in_motion(one: Motion, mass: float, stiffness: float) -> list[complex]:
    """Force per ampere (N/A) in each of BANDS, by what the ball does after steps.

    Nothing but magnet and weight acts on it, so (ks + m w^2) gap = g(w) i. Differences of what begins and ends at rest
    have spectra without leakage.

    Args:
        one: recording with steps.
        mass: kg.
        stiffness: -negative stiffness (N/m), at rest.
    """
    f = np.fft.rfftfreq(LINES, 1 / one.rate)
    cross, power = np.zeros(f.size, complex), np.zeros(f.size)
    for at in one.steps:
        part = slice(at - round(BEFORE * one.rate), at + round(AFTER * one.rate))
        gap, current = (np.fft.rfft(np.diff(v[part]), LINES) for v in (one.gap, one.current))
        cross += current * gap.conj()
        power += abs(gap) ** 2
    found = []
    for low, high in BANDS:
        on = (f >= low) & (f < high)
        w = 2 * np.pi * np.average(f[on], weights=power[on])
        found.append(complex((stiffness + mass * w**2) * power[on].sum() / cross[on].sum()))
    return found


def at_rest(points: list[tuple[float, float]], mass: float, gravity: float, gap: float) -> tuple[float, float, float]:
    """Gain (N/A), stiffness (N/m, positive) and effective length a (m) of i = s (gap + a) through points of rest."""
    slope, level = np.polyfit(*np.array(points).T, 1)
    gain = 2 * mass * gravity / (level + slope * gap)
    return float(gain), float(gain * slope), float(level / slope)


def picture(all_rests: dict[str, list[tuple[float, float]]], gains: dict[str, list[complex]], rig: Rig, still: float):
    """Weight over the published force at rest, and the gain over frequency."""
    figure = Figure(figsize=(9, 6.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, points in all_rests.items():
        y, i = np.array(points).T
        left.plot(1e3 * y, rig.mass * rig.gravity / published(rig, y, i), "o", label=name)
    left.axhline(1, color="#999999", ls=":")
    left.set(xlabel="gap at rest in mm", ylabel="weight over the published law's force")
    middle = [np.sqrt(low * high) for low, high in BANDS]
    for name, g in gains.items():
        right.semilogx(middle, np.abs(g), "o-", label=name)
    right.axhline(still, color="#222222", ls="--", label="at rest")
    right.set(
        xlabel="frequency in Hz", ylabel="gain in N/A", ylim=(0, 1.1 * max(still, np.abs(list(gains.values())).max()))
    )
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    return figure


def published(rig: Rig, gap: np.ndarray, current: np.ndarray) -> np.ndarray:
    """Force (N) of the published inductance."""
    return rig.force_constant * current**2 / (gap + rig.gap_offset) ** 2


def main(folder: Path, out: Path) -> None:
    """Print both tables and draw them."""
    campaign = load_campaign(folder)
    rig = campaign.rig
    stepped = [m for m in (motion(campaign, r) for r in campaign.recordings) if m.stepped]
    all_rests = {m.name: list(rests(m)) for m in stepped}
    print("| recording | gap at rest | current | weight over the published force |\n|---|---|---|---|")
    for name, points in all_rests.items():
        for y, i in points:
            over = rig.mass * rig.gravity / published(rig, np.array(y), np.array(i))
            print(f"| {name} | {1e3 * y:.2f} mm | {i:.4f} A | {over:.2f} |")
    points = [p for those in all_rests.values() for p in those]
    gain, stiffness, length = at_rest(points, rig.mass, rig.gravity, rig.gap)
    print(f"\nat rest at {1e3 * rig.gap:g} mm: gain {gain:.3f} N/A, stiffness {-stiffness:.1f} N/m")
    print(f"force as 1 / (gap + {1e3 * length:.1f} mm)^2\n")
    gains = {m.name: gain_in_motion(m, rig.mass, stiffness) for m in stepped}
    print("| gain by motion | " + " | ".join(gains) + " |\n|---|" + "---|" * len(gains))
    for k, (low, high) in enumerate(BANDS):
        row = (f"{abs(g[k]):.2f} N/A, {np.degrees(np.angle(g[k])):+.0f}°" for g in gains.values())
        print(f"| {low:g} to {high:g} Hz | " + " | ".join(row) + " |")
    picture(all_rests, gains, rig, gain).savefig(out, dpi=110, metadata={"Software": None})
    print(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="A measured ball below a coil, at rest and in motion.")
    parser.add_argument("folder", type=Path, help="measured_ball, with the recordings in it")
    parser.add_argument("--out", type=Path, default=Path("measured_ball.png"))
    asked = parser.parse_args()
    main(asked.folder, asked.out)
