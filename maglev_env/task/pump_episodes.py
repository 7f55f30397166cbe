"""Episodes of a spinning rotor: axis, body and unbalance drawn around the nominal ones, and tuning's starting point."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.fields import is_number
from maglev_env.loop.gains import Gains
from maglev_env.rig.drawn import scaled_rig, tolerance_factors
from maglev_env.rotor.rotor import CONTROLS, Rotor
from maglev_env.task.episodes import START
from maglev_env.task.gain_box import GainBox, gain_box

CONTROL = ("translation_tilt", "planes", "common")
RANDOMIZATIONS = ("none", "tolerances")


@dataclass(frozen=True, eq=False)
class RotorEpisode:
    """A drawn rotor, the first action (k,) and the seed of the noise of its experiments."""

    rotor: Rotor
    start: np.ndarray
    seed: int


def controlled(rotor: Rotor, control: str) -> Rotor:
    """The rotor with another kind of controllers.

    Translation and tilt controllers with equal gains are the same as controllers of both planes with these gains where
    the planes lie symmetrically about the centre of mass, so only those can be converted.

    Args:
        rotor: with two controllers.
        control: one of CONTROL; "common" keeps the rotor's own kind and gives both the gains of the first one.

    Raises:
        ValueError: The kind is unknown, or the gains differ and cannot be converted.
    """
    if control not in CONTROL:
        raise ValueError(f"control = {control!r}; use one of {', '.join(CONTROL)}")
    first, second = rotor.gains.values()
    if control == "common":
        return replace(rotor, gains=dict.fromkeys(rotor.gains, first))
    names = CONTROLS[CONTROL.index(control)]
    if names != tuple(rotor.gains) and any(a + b for a, b in (rotor.planes.magnets, rotor.planes.probes)):
        raise ValueError(
            f"control = {control!r}: the planes of rotor {rotor.name} do not lie symmetrically about its centre of "
            f"mass; give it [gains.{names[0]}] and [gains.{names[1]}]"
        )
    if names != tuple(rotor.gains) and first != second:
        raise ValueError(
            f"control = {control!r}: rotor {rotor.name} has other gains for {' than for '.join(rotor.gains)}, which no "
            f"gains of {' and '.join(names)} are; give it [gains.{names[0]}] and [gains.{names[1]}]"
        )
    return replace(rotor, gains=dict(zip(names, (first, second), strict=True)))


def rotor_box(
    rotor: Rotor, control: str, tuned: Sequence[str], bounds: Mapping[str, Sequence[float]] | None
) -> GainBox:
    """The box of some gains of both controllers.

    Args:
        rotor: with the controllers of `control`.
        control: one of CONTROL; with "common" an element of the box is a gain of both controllers (kp), otherwise of
            one (kp_tilt).
        tuned: names of the gains of each controller.
        bounds: (low, high) by name; otherwise the rotor's.
    """
    boxes = []
    for gains in rotor.gains.values():
        rig = replace(rotor.axis, name=rotor.name, gains=gains, bounds={**rotor.axis.bounds, **rotor.bounds})
        boxes.append(gain_box(rig, tuned, bounds))
    if control == "common":
        return boxes[0]
    names = tuple(f"{name}_{own}" for own, box in zip(rotor.gains, boxes, strict=True) for name in box.names)
    low, high, log = (np.concatenate([getattr(box, end) for box in boxes]) for end in ("low", "high", "log"))
    return GainBox(names, low, high, log, tuple(unit for box in boxes for unit in box.units))


def gains_at(rotor: Rotor, gains: np.ndarray, tuned: Sequence[str]) -> Rotor:
    """The rotor with the gains (k,) of its box: of the first controller, then the second, or of both."""
    rows = np.broadcast_to(np.reshape(gains, (-1, len(tuned))), (2, len(tuned)))
    pairs = zip(rotor.gains.items(), rows, strict=True)
    return replace(
        rotor, gains={name: replace(g, **dict(zip(tuned, map(float, row), strict=True))) for (name, g), row in pairs}
    )


def preset_of(rotor: Rotor, tuned: Sequence[str], box: GainBox) -> np.ndarray:
    """The rotor's own gains as an action (k,)."""
    controllers: list[Gains] = list(rotor.gains.values())[: len(box.names) // len(tuned)]
    return box.actions([getattr(gains, name) for gains in controllers for name in tuned])


def check_draw(rotor: Rotor, randomization: str, unbalance: Sequence[float]) -> tuple[float, float]:
    """The checked range of the unbalance's factors.

    Raises:
        ValueError: The randomization is unknown, the rotor has no tolerances, or the range is not valid.
    """
    if randomization not in RANDOMIZATIONS:
        raise ValueError(f"randomization = {randomization!r}; use one of {', '.join(RANDOMIZATIONS)}")
    if randomization == "tolerances" and not rotor.axis.tolerance:
        raise ValueError(f"randomization = 'tolerances': the axis of rotor {rotor.name} has no [tolerance]")
    pair = tuple(unbalance)
    if len(pair) != 2 or not all(map(is_number, pair)) or not 0 < pair[0] <= pair[1]:
        raise ValueError(f"unbalance = {unbalance!r}; give two factors, 0 < low <= high")
    return float(pair[0]), float(pair[1])


def draw_rotor_episode(
    rotor: Rotor, preset: np.ndarray, randomization: str, unbalance: tuple[float, float], rng: np.random.Generator
) -> RotorEpisode:
    """Draw one episode; all random numbers come from rng, in a fixed order.

    Args:
        rotor: the nominal rotor.
        preset: its gains as an action, (k,).
        randomization: one of RANDOMIZATIONS.
        unbalance: range of the factors of static and couple unbalance.
        rng: source of all random numbers.
    """
    drawn = rotor
    if randomization == "tolerances":
        axis, body, u = rotor.axis, rotor.body, rotor.unbalance
        factors = tolerance_factors(axis, rng)
        # A heavier rotor is assumed to be of denser material, so its inertias are proportional to its mass.
        dense = factors.get("mass", 1.0)
        heavy = {n: getattr(body, n) * dense for n in ("mass", "transverse_inertia", "polar_inertia")}
        static, couple = map(float, np.exp(rng.uniform(*np.log(unbalance), size=2)))
        drawn = replace(
            rotor,
            axis=scaled_rig(axis, factors),
            body=replace(body, **heavy),
            known=rotor,
            unbalance=replace(u, static=u.static * static, couple=u.couple * couple),
        )
    start = START * rng.uniform(-1.0, 1.0, size=preset.size) + (1 - START) * preset
    return RotorEpisode(drawn, start, int(rng.integers(2**63)))
