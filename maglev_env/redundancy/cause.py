"""From rows that are off to the channel that is wrong: which change, or which two, explain all rows together.

A factor or delay on one channel moves the gain or delay of every row that holds it, by its power there, and no other
row. A cause is accepted if every row agrees with it within tolerance and error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from maglev_env.redundancy.rows import LEVEL, Row

PARAMETERS = ("mass", "actuator gain", "gains")
ROUGH = 0.02  # how well two rows must agree on a factor, beyond tolerance and errors
SAME_DELAY = 0.3  # of a sample, likewise


@dataclass(frozen=True)
class Cause:
    """One channel's factor (its logarithm and sign) and delay (s), and their errors."""

    name: str
    size: float
    negative: bool
    delay: float
    size_se: float
    delay_se: float


def causes(rows: Sequence[Row], rate: float) -> list[Cause]:
    """Single causes that explain gains, signs and delays of all rows; what no gain is off by is no mass or gain."""
    names = _names(rows)
    if not any(row.gain_off() for row in rows):
        names = [name for name in names if name not in PARAMETERS]
    return [found[0] for name in names if (found := _causes((name,), rows, rate)) is not None]


def two_causes(rows: Sequence[Row], rate: float) -> tuple[Cause, ...]:
    """The two channels that explain all rows together, where only one pair does and rows are left to check it by."""
    channels = [name for name in _names(rows) if name not in PARAMETERS]
    pairs = [p for p in combinations(channels, 2) if sum(bool({*p} & r.powers.keys()) for r in rows) > len(p)]
    found = [one for pair in pairs if (one := _causes(pair, rows, rate)) is not None]
    return found[0] if len(found) == 1 else ()


def _names(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.powers))


def _causes(names: tuple[str, ...], rows: Sequence[Row], rate: float) -> tuple[Cause, ...] | None:
    """The sizes, signs and delays of these causes; None where some row contradicts them all the same."""
    rows = [row for row in rows if row.known]
    with_it = [row for row in rows if row.powers.keys() & {*names}]
    spread = [r.gain_se + r.tolerance / LEVEL for r in with_it]
    sizes = _mean(names, [(r, r.size, s, s) for r, s in zip(with_it, spread, strict=True)])
    late = tuple(name for name in names if name not in PARAMETERS)
    delays = _mean(late, [(r, r.delay, r.delay_se + r.delay_tolerance / LEVEL, r.delay_se) for r in with_it
                          if r.delay is not None])  # fmt: skip
    if sizes is None:
        return None
    delays = {name: (0.0, 0.0) for name in names} | (delays or {})
    signs = (s for s in product((False, True), repeat=len(names)) if not ("mass" in names and s[names.index("mass")]))
    negative = next(
        (dict(zip(names, s, strict=True)) for s in signs if _signs_agree(dict(zip(names, s, strict=True)), rows)), None
    )
    if negative is None:
        return None
    slack = SAME_DELAY / rate
    for row in rows:
        powers = {name: row.powers.get(name, 0) for name in names}
        size, delay = (sum(power * of[name][0] for name, power in powers.items()) for of in (sizes, delays))
        held = sum(map(abs, powers.values()))
        gain_limit = row.tolerance + LEVEL * row.gain_se + (ROUGH + row.misfit) * held + 0.02 * abs(size)
        if abs(row.size - size) > gain_limit:
            return None
        if row.gain_off(negative=row.gain < 0) and abs(row.size - size) > abs(row.size) / 2:
            return None  # within a wide tolerance, but it is not what the row is off by
        if row.delay is not None and abs(row.delay - delay) > row.delay_tolerance + LEVEL * row.delay_se + slack * held:
            return None
    if any(abs(sizes[n][0]) < ROUGH and not negative[n] and abs(delays[n][0]) < slack for n in names):
        return None  # what is not wrong explains nothing
    return tuple(Cause(n, sizes[n][0], negative[n], delays[n][0], sizes[n][1], delays[n][1]) for n in names)


def _signs_agree(negative: Mapping[str, bool], rows: Sequence[Row]) -> bool:
    return all(
        (row.gain < 0) == bool(sum(negative[n] for n in row.powers if n in negative) % 2) for row in rows if row.signed
    )


def _mean(
    names: tuple[str, ...], values: Sequence[tuple[Row, float, float, float]]
) -> dict[str, tuple[float, float]] | None:
    """Sizes and standard errors of causes from (row, value, weight's standard deviation, standard error)."""
    if not names or not values:
        return None
    powers = np.array([[row.powers.get(name, 0) for name in names] for row, *_ in values], float)
    _, v, spread, se = (np.array(column, float if i else object) for i, column in enumerate(zip(*values, strict=True)))
    spread = np.maximum(spread, 1e-12)
    if np.linalg.matrix_rank(powers) < len(names):
        return None
    solve = np.linalg.pinv(powers / spread[:, None]) / spread
    return dict(zip(names, zip(solve @ v, np.sqrt(solve**2 @ se**2), strict=True), strict=True))
