"""What the page has set: the gains and effects that arrive from the sliders, checked and made an experiment."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.fields import check_known, is_number
from maglev_env.loop.axes import AXES
from maglev_env.loop.effect import as_effects, check_effects
from maglev_env.loop.gains import Controllers, with_gains
from maglev_env.rig.rig import Rig
from maglev_workbench.explore.quantities import UNIT_SYSTEMS, UnitSystem

_KEYS = ("gains", "effects", "axis", "units", "seed")


@dataclass(frozen=True)
class Setting:
    """The state of the page.

    Args:
        experiment: the rig's protocol with the gains and effects of the page.
        axis: which axis the curves are of.
        units: how numbers are written.
    """

    experiment: Experiment
    axis: int
    units: UnitSystem


def setting_from(data: Any, rig: Rig, controllers: Controllers) -> Setting:
    """The setting that the page has sent.

    Args:
        data: gains by name and effects by name and parameter, in SI; axis; units; seed.
        rig: with a protocol. Its own effects count only where `data` has them, so that they can be switched off.
        controllers: whose gains are replaced; of two different ones, those of the axis shown.

    Raises:
        ValueError: A value is not valid; the message names it.
    """
    if not isinstance(data, Mapping):
        raise ValueError("the setting must be a table of gains, effects, axis and units")
    check_known(data, _KEYS, "setting")
    axis, units, seed = data.get("axis", 0), data.get("units", "files"), data.get("seed", 0)
    if type(axis) is not int or not 0 <= axis < rig.axes:
        raise ValueError(f"axis = {axis!r}; rig {rig.name} has {', '.join(map(str, range(rig.axes)))}")
    if units not in UNIT_SYSTEMS:
        raise ValueError(f"units = {units!r}; use one of {', '.join(UNIT_SYSTEMS)}")
    if type(seed) is not int or seed < 0:
        raise ValueError(f"seed = {seed!r} must be a whole number, at least 0")
    gains = _gains(data.get("gains", {}))
    if isinstance(controllers, tuple) and controllers[0] != controllers[1]:
        pair = [with_gains(own, **gains) if at == axis else own for at, own in enumerate(controllers)]
        controllers = (pair[0], pair[1])  # type: ignore[assignment]
    else:
        controllers = with_gains(controllers, **gains)
    effects = as_effects(data.get("effects", {}))
    check_effects(effects, rig)
    return Setting(protocol_experiment(replace(rig, effects={}), controllers, effects, seed), axis, units)


def _gains(given: Any) -> dict[str, float]:
    if not isinstance(given, Mapping):
        raise ValueError(f"gains = {given!r:.50} must be a table of numbers")
    for name, value in given.items():
        if not is_number(value):
            raise ValueError(f"{name} = {value!r:.50} is not a number")
    return {str(name): float(value) for name, value in given.items()}


def axis_name(setting: Setting) -> str:
    """ " x" or " y" on a rig of two axes, for sentences."""
    return f" {AXES[setting.axis]}" if setting.experiment.rig.axes == 2 else ""
