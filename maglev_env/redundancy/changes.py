"""What changes from period to period that should not: a clock, an instrument's range; and what should, the noise."""

from itertools import combinations

import numpy as np

from estimation.lines.periods import period_drift, period_spectra
from maglev_env.recordings.excited import other_clock
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import lines_at

LEAST = 4  # periods after the first one
APART, CLEAR = 0.05, 8.0  # samples by which two clocks drift apart over the recording, and standard errors of that
ALL_APART = 1.0  # the same for a clock that all channels have, against that of the excitation
STEP, STEADY = 1.5, 0.1  # factor of a change of range, and scatter on either side as a share of its logarithm
ALIKE = 0.5  # share of a period's power that may be no scaled copy: the channel's noise


def clocks(view: View) -> list[Finding]:
    """Two channels whose periods have different lengths, as recorded by two devices.

    Each period's phases give its shift against the one in the middle; over the periods the shifts of all channels grow
    alike, because one excitation drives them. Under the null hypothesis their difference is normal about zero.
    """
    if not view.periodic:
        return []
    kept, w = _kept(view), 2 * np.pi * lines_at(view.excitations) * view.block[1] / view.block[0]
    late = [p for p in kept if p >= view.lines.first]  # a rotor may still ring, or a drift look like that
    of: dict[str, tuple[float, float]] = {}
    for name in sorted(view.recorded & set(view.blocks[0])):
        for some in (kept, late):
            if name not in of and (found := period_drift(_spectra(view, name, some), w, some)):
                of[name] = found
    worst, lasting = None, kept[-1] - kept[0] + 1 if kept else 0
    for one, other in combinations(of, 2):
        (a, a_se), (b, b_se) = of[one], of[other]
        error = np.hypot(a_se, b_se)
        if abs(a - b) * lasting > APART and abs(a - b) > CLEAR * error and (worst is None or abs(a - b) > worst[0]):
            worst = abs(a - b), error
    if worst is None:
        return _all_apart(view, list(of.values()), lasting)
    middle = float(np.median([a for a, _ in of.values()]))
    alone = [n for n, (a, se) in of.items() if abs(a - middle) > CLEAR * se and abs(a - middle) > 0.5 * worst[0]]
    names = alone if len(of) > 2 and len(alone) == 1 else list(of)
    rate, error = (1e6 * v / view.block[0] for v in worst)
    text = (
        f"{' or '.join(names)}: recorded by another clock than the rest: they drift apart by {rate:.3g} +- "
        f"{2 * error:.1g} ppm; record all channels by one device"
    )
    return [Finding("clock", view.recording, " or ".join(names), rate, (rate - 2 * error, rate + 2 * error), text,
                    "wiring")]  # fmt: skip


def _all_apart(view: View, drifts: list[tuple[float, float]], periods: int) -> list[Finding]:
    """All channels by one clock, which is not that of the excitation."""
    a, error = min(drifts, key=lambda one: one[1], default=(0.0, 1.0))
    if abs(a) * periods < ALL_APART or abs(a) < CLEAR * error:
        return []
    ppm, error = (1e6 * v / view.block[0] for v in (-a, error))
    text = f"all channels: {other_clock(ppm, view.rate)}"
    return [Finding("clock", view.recording, "all channels", ppm, (ppm - 2 * error, ppm + 2 * error), text, "wiring")]


def _kept(view: View) -> list[int]:
    """Blocks but the first, in which the excitation may begin."""
    return [p for p in range(1, len(view.blocks[1])) if p not in view.left_out]


def _spectra(view: View, name: str, kept: list[int]) -> np.ndarray:
    names, blocks = view.blocks
    return period_spectra(blocks[kept, names.index(name)], lines_at(view.excitations) * view.block[1])


def ranges_changed(view: View) -> list[Finding]:
    """A channel whose periods are larger copies of the earlier ones, as where an instrument changes its range."""
    if not view.periodic:
        return []
    kept = _kept(view)
    if len(kept) < LEAST:
        return []
    names, found = sorted(view.recorded & set(view.blocks[0])), []
    for name in names:
        if (change := _step(_spectra(view, name, kept))) is not None:
            found.append((name, kept[change[0]], change[1]))
    if not found:
        return []
    _, at, factor = found[0]
    alike = len(found) == len(names) > 1
    who = "all channels" if alike else " or ".join(n for n, *_ in found)
    why = "the excitation changed" if alike else "an instrument changed its range"
    text = (
        f"{who}: from the period at {at * view.block[0] / view.rate:.4g} s on {factor:.3g} times as large as before: "
        f"{why}; use the part before or after (start, samples)"
    )
    return [Finding("range change", view.recording, who, factor, None, text, "wiring")]


def _step(spectra: np.ndarray) -> tuple[int, float] | None:
    """Index and factor of one step between copies (periods, n); the step may lie within one period, which is none."""
    for reference in (spectra[0], spectra[-1]):
        power = (np.abs(reference) ** 2).sum()
        if not power:
            continue
        factor = (spectra @ reference.conj()).real / power
        left = (np.abs(spectra - factor[:, None] * reference) ** 2).sum(axis=1)
        copy = (left < ALIKE * (np.abs(spectra) ** 2).sum(axis=1)) & (factor > 0)
        size = np.where(copy, np.log(np.maximum(factor, 1e-12)), np.nan)
        for gap in (0, 1):
            for k in range(1, size.size):
                before, after = size[:k], size[k + gap :]
                if after.size == 0 or before.size + after.size < LEAST - 1:
                    continue
                step = float(np.median(after) - np.median(before))  # nan where one is no copy
                if abs(step) > np.log(STEP) and max(np.ptp(before), np.ptp(after)) < STEADY * abs(step):
                    return k, float(np.exp(step))
    return None


def copies(view: View) -> list[Finding]:
    """Periods of a measured channel that are equal to the last digit, which no reading of a sensor is."""
    if not copied(view):
        return []
    text = (
        "all channels: every period is a copy of the others to the last digit: an average that was stored again and "
        "again, or a simulation without noise; nothing tells the noise, so intervals are too narrow; record the "
        "periods themselves"
    )
    return [Finding("repeated", view.recording, "all channels", None, None, text, "quality")]


def copied(view: View) -> bool:
    """Whether all periods but the first are the same."""
    if not view.periodic:
        return False
    names, blocks = view.blocks
    measured = [i for i, name in enumerate(names) if name in ("displacement", "current") and name in view.recorded]
    return len(blocks) > 2 and bool(measured) and bool((blocks[1:, measured] == blocks[-1:, measured]).all())
