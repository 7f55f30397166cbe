"""Any linear digital controller of an axis: one denominator, a numerator for each input, and a limit of the command."""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import mul
from typing import Literal

import numpy as np
import scipy

from maglev_env.fields import is_number

AntiWindup = Literal["tracking", "none"]
ANTI_WINDUP = ("tracking", "none")
Limit = tuple[float, float]


@dataclass(frozen=True)
class LinearController:
    """The command of an axis from its reference r (m), its reading y (m) and its coil's current i (A), by polynomials.

    In z at the control rate, with every signal counted from the operating point:

        command = limit([reference r - numerator y - current i - cut (command without limit - command)] / denominator)

    Without `reference`, `current` and `limit` it is a filter of the error r - y, A/m.

    Args:
        numerator: coefficients for the reading, A/m, highest power of z first.
        denominator: likewise; it starts with 1.
        reference: for the reference, A/m; None: those of the reading.
        current: for the current, A/A, which is sampled together with the reading; empty: it is not read.
        limit: lowest and highest command, A; what is injected is added behind it. None: no limit.
        anti_windup: what the limit cuts off is fed back with the numerator `cut`. "tracking": the recursion goes on
            from the limited command; "none": from the unlimited one; or the coefficients of `cut`, of a lower power
            than the denominator.

    Raises:
        ValueError: A coefficient is not finite, the denominator does not start with 1, a numerator is longer than the
            denominator, or the limit or anti_windup does not fit.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    reference: tuple[float, ...] | None = None
    current: tuple[float, ...] = ()
    limit: Limit | None = None
    anti_windup: AntiWindup | tuple[float, ...] = "tracking"

    def __post_init__(self) -> None:
        polynomials = {"numerator": self.numerator, "denominator": self.denominator}
        if self.reference is not None:
            polynomials["reference"] = self.reference
        if self.current != ():
            polynomials["current"] = self.current
        if self.anti_windup not in ANTI_WINDUP:
            polynomials["anti_windup"] = self.anti_windup
        for name, values in polynomials.items():
            if not isinstance(values, tuple) or not values or not all(map(is_number, values)):
                also = ' or "tracking" or "none"' if name == "anti_windup" else ""
                raise ValueError(f"controller: {name} = {values!r}; give finite numbers, the highest power of z first"
                                 f"{also}")  # fmt: skip
        if self.denominator[0] != 1:
            raise ValueError(
                f"controller: the denominator starts with {self.denominator[0]:g}, not 1; divide numerator and "
                f"denominator by it (and leave out leading zeros)"
            )
        for name, values in polynomials.items():
            if len(values) > len(self.denominator) - (name == "anti_windup"):
                raise ValueError(
                    f"controller: {'the ' * (name == 'numerator')}{name} has a higher power of z than the denominator, "
                    "so it would need the future"
                )
        check_limit(self.limit)

    @property
    def order(self) -> int:
        return len(self.denominator) - 1

    @property
    def reads_current(self) -> bool:
        """Whether the coil's current is an input."""
        return any(self.current)

    @property
    def of_error(self) -> bool:
        """Whether it is a filter of the error alone, without a limit."""
        return self.reference is None and not self.reads_current and self.limit is None

    @property
    def numerators(self) -> np.ndarray:
        """Numerators (3, order + 1) of the reference, the negative reading and the negative current."""
        return np.array([self._whole(self.numerator if p is None else p) for p in
                         (self.reference, self.numerator, self.current)])  # fmt: skip

    @property
    def cut(self) -> np.ndarray:
        """Numerator (order + 1,) of what the limit cuts off, which is subtracted; it starts with 0."""
        if self.anti_windup == "tracking":
            return -np.array((0.0, *self.denominator[1:]))
        return self._whole(() if self.anti_windup == "none" else self.anti_windup)

    def output(self, inputs: Sequence[np.ndarray | None]) -> np.ndarray:
        """The command (samples,) from rest.

        Args:
            inputs: reference, negative reading and negative current, (samples,) each; None: zeros.
        """
        forward = np.sum(
            [scipy.signal.lfilter(b, 1.0, x) for b, x in zip(self.numerators, inputs, strict=True) if x is not None], 0
        )
        if self.limit is None:
            return np.asarray(scipy.signal.lfilter([1.0], self.denominator, forward))
        (low, high), n = self.limit, self.order
        # Coefficients of the last n commands before and behind the limit, the oldest first.
        before, behind = (np.array(self.denominator) + self.cut)[:0:-1].tolist(), self.cut[:0:-1].tolist()
        free, found = [0.0] * n, [0.0] * n
        for k, moved in enumerate(forward.tolist()):
            u = moved - sum(map(mul, before, free[k : k + n])) + sum(map(mul, behind, found[k : k + n]))
            free.append(u)
            found.append(min(max(u, low), high))
        return np.array(found[n:])

    def _whole(self, polynomial: tuple[float, ...]) -> np.ndarray:
        """A polynomial with leading zeros to as many coefficients as the denominator."""
        return np.concatenate([np.zeros(self.order + 1 - len(polynomial)), polynomial])


def check_limit(limit: Limit | None) -> None:
    """Check a controller's limit; None is accepted.

    Raises:
        ValueError: It is not two increasing numbers, or the command at rest, 0, is not between them.
    """
    if limit is None:
        return
    if not (isinstance(limit, tuple) and len(limit) == 2 and all(map(is_number, limit)) and limit[0] < limit[1]):
        raise ValueError(f"controller: limit = {limit!r} must be two increasing numbers, [low, high] in A")
    if not limit[0] < 0 < limit[1]:
        raise ValueError(
            f"controller: limit = {list(limit)} leaves no room for the command 0, that of the rotor at rest; commands "
            "count from the operating point: with a bias of 0.8 A a coil's 0 .. 3 A are [-0.8, 2.2]"
        )
