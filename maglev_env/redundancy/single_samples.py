"""Single readings that are far from those around them, in recordings that never repeat."""

import numpy as np

from maglev_env.channels import unit_of
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.view import View

AROUND = 2  # samples on each side that tell where a reading should be
FAR = 20.0  # robust standard deviations of what a reading differs from the median around it
APART, ALONE = 3.0, 8.0  # times the largest difference of all others; the same of one that is alone
CLOSE = 0.3  # share of the difference within which the readings on both sides agree: those of a blow do not
MOST = 0.002  # share of samples that are single ones; more is noise
STEPS = 5  # converter steps


def single_samples(view: View) -> list[Finding]:
    """Readings of the position that leave it for one sample, as no mass does: a lost word, a contact.

    A reading counts where both sides agree, and where it is farther from them than any other of the record. Beside a
    step of the reference nothing is said, since a magnet's current may be heard in a probe.
    """
    if view.periodic:
        return []  # the periods tell more, see `periods.outliers`
    found = []
    for name in ("displacement", "gap_estimate"):
        if name in view.recorded and name in view.channels and view.channels[name].size > 100 * AROUND:
            found += _found(view, name)
    return found


def _found(view: View, name: str) -> list[Finding]:
    values = view.channels[name]
    around = np.stack([np.roll(values, k) for k in range(-AROUND, AROUND + 1)])
    rest = np.abs(values - np.median(around, axis=0))
    rest[:AROUND] = rest[-AROUND:] = 0.0
    if view.masked is not None:
        rest[np.convolve(view.masked, np.ones(2 * AROUND + 1), "same") > 0] = 0.0
    if (wanted := view.channels.get("reference")) is not None:
        changes = np.diff(wanted, prepend=wanted[:1]) != 0
        if changes.mean() < MOST:
            rest[np.convolve(changes, np.ones(4 * AROUND + 1), "same") > 0] = 0.0
    steps = np.abs(np.diff(values))
    moves = steps[steps > 0]
    if not moves.size:
        return []
    step = float(moves[moves > 1e-6 * np.median(moves)].min())
    least = max(FAR * 1.4826 * float(np.median(rest)), STEPS * step)
    order = np.sort(rest)[::-1][: int(MOST * rest.size) + 2]
    # The events end at the difference that all others fall short of by most.
    gaps = [k for k in range(order.size - 1) if order[k] > max(least, (APART if k else ALONE) * order[k + 1])]
    if not gaps:
        return []
    last = max(gaps, key=lambda k: order[k] / max(order[k + 1], step))
    at = np.flatnonzero(rest >= order[last])
    beside = np.stack([values[at + k] for k in (*range(-AROUND, 0), *range(1, AROUND + 1))])
    if (np.ptp(beside, axis=0) > CLOSE * rest[at]).any():
        return []
    worst = int(at[np.argmax(rest[at])])
    many = f"{at.size} single samples, the first" if at.size > 1 else "a single sample"
    text = (
        f"{name}: {many} at {at[0] / view.rate:.5g} s, the worst {rest[worst]:.3g} {unit_of(name)} from those on both "
        f"sides at {worst / view.rate:.5g} s, at least {order[last] / max(order[last + 1], step):.2g} times as "
        "far as all others: readings were lost there; leave them empty in the file, or out (start, samples)"
    )
    return [Finding("spike", view.recording, name, float(rest[worst]), None, text, "wiring")]
