"""Which effects cannot be told apart on which channels: an honest diagnosis can only name their class."""

from collections.abc import Collection
from math import inf

# Channel set -> classes of effects, each up to a size in multiples of the detection threshold. Two effects are
# distinguished by the signals on either side of the block in which they act.
ALIKE: dict[str, tuple[tuple[frozenset[str], float], ...]] = {
    # All lags of the loop add up to one lag from command to reading.
    "displacement": (
        (frozenset({"delay", "amplifier_lag", "sensor_lag", "eddy_current", "dropped_samples"}), inf),
        (frozenset({"actuator_gain", "sensor_gain"}), inf),
        (frozenset({"sensor_resonance", "support_resonance"}), inf),
    ),
    # Command and current are known, but from the current to the reading only products are: of lags, of gains, of modes.
    # A delay differs from a lag by (w T)^2 / 2 of the current. On these channels the threshold is so low that this
    # shows from about 20 times the threshold: the squared distance of the two is 0.3 at 10 times, grows as T^4 and
    # reaches 4.7.
    "no_force": (
        (frozenset({"delay", "amplifier_lag"}), 20.0),
        (frozenset({"sensor_lag", "eddy_current"}), inf),
        (frozenset({"actuator_gain", "sensor_gain"}), inf),
        (frozenset({"sensor_resonance", "support_resonance"}), inf),
    ),
    "full": (
        (frozenset({"delay", "amplifier_lag"}), 20.0),
        (frozenset({"sensor_lag", "eddy_current"}), inf),
    ),
}
# On any channels: the springs, at one bias and along one axis, one of which is another force law of a pair that moves
# little; and both tones at the rotation frequency, which differ only in their growth with the speed.
ALWAYS = frozenset({"negative_stiffness", "support_stiffness", "force_law"})
AT_ONE_SPEED = frozenset({"runout", "unbalance"})


def alike(effects: Collection[str], channels: str, size: float, one_speed: bool) -> bool:
    """Whether effects form one class that a channel set cannot separate. One effect alone is a class.

    Args:
        effects: Names of the effects.
        channels: Channel set "full", "no_force" or "displacement".
        size: Multiples of the detection threshold.
        one_speed: Whether all recordings ran at one speed of rotation.

    Raises:
        ValueError: The channel set is unknown.
    """
    if channels not in ALIKE:
        raise ValueError(f"channel set {channels!r} is unknown; known: {', '.join(ALIKE)}")
    classes = [members for members, up_to in ALIKE[channels] if size < up_to]
    classes += [ALWAYS, *([AT_ONE_SPEED] if one_speed else [])]
    return len(set(effects)) == 1 or any(set(effects) <= one for one in classes)


def alike_sets(one: frozenset[str], other: frozenset[str], channels: str, size: float, one_speed: bool) -> bool:
    """Whether two hypotheses, one effect or a pair each, are alike effect by effect, in some order."""
    a, b = sorted(one), sorted(other)
    return len(a) == len(b) and any(
        all(alike((x, y), channels, size, one_speed) for x, y in zip(a, order, strict=True)) for order in (b, b[::-1])
    )
