"""Which effects look alike on which channels: a class of these is as much as an honest diagnosis can name."""

from collections.abc import Collection
from math import inf

# Channel set -> classes, each up to a size in multiples of the detection threshold. What tells two effects apart are
# the signals on either side of the block that they sit in.
ALIKE: dict[str, tuple[tuple[frozenset[str], float], ...]] = {
    # Every lag of the loop adds up to one lag from command to reading.
    "displacement": (
        (frozenset({"delay", "amplifier_lag", "sensor_lag", "eddy_current"}), inf),
        (frozenset({"actuator_gain", "sensor_gain"}), inf),
        (frozenset({"sensor_resonance", "support_resonance"}), inf),
    ),
    # Command and current are known, but from there to the reading only products: of lags, of gains, of modes. A delay
    # differs from a lag by (w T)^2 / 2 of the current: on these channels the threshold is so low that this shows from
    # about 20 times it on, where the squared distance of the two, 0.3 at 10 times and growing as T^4, reaches 4.7.
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
# On any channels: one spring, at one bias and along one axis; both tones at 1x, where only their growth with the speed
# of rotation differs.
ALWAYS = frozenset({"negative_stiffness", "support_stiffness"})
AT_ONE_SPEED = frozenset({"runout", "unbalance"})


def alike(effects: Collection[str], channels: str, size: float, one_speed: bool) -> bool:
    """Whether all effects, by name, are one class on a channel set: "full", "no_force" or "displacement".

    size: multiples of the detection threshold. one_speed: all recordings ran at one speed of rotation. One effect alone
    is a class. ValueError for another channel set.
    """
    if channels not in ALIKE:
        raise ValueError(f"channel set {channels!r} is unknown; known: {', '.join(ALIKE)}")
    classes = [members for members, up_to in ALIKE[channels] if size < up_to]
    classes += [ALWAYS, *([AT_ONE_SPEED] if one_speed else [])]
    return len(set(effects)) == 1 or any(set(effects) <= one for one in classes)


def alike_sets(one: frozenset[str], other: frozenset[str], channels: str, size: float, one_speed: bool) -> bool:
    """Whether two hypotheses, one effect or a pair each, are alike: effect by effect in some order."""
    a, b = sorted(one), sorted(other)
    return len(a) == len(b) and any(
        all(alike((x, y), channels, size, one_speed) for x, y in zip(a, order, strict=True)) for order in (b, b[::-1])
    )
