"""The experiments by name, in the order of the dissertation's chapters; their modules are imported on demand."""

from collections.abc import Sequence
from importlib import import_module

from maglev_workbench.commands.reproduce.item import Item

# Name on the command line -> module of this package that holds it.
HOME = {
    "hydraulics": "hydraulics",
    "bearing-coefficients": "bearing_design",
    "flux-map": "flux_map",
    "stability-conditions": "bearing_design",
    "motor": "motor_drive",
    "levitation": "pump",
    "run-up": "pump",
    "coil-current": "pump",
    "axial-force": "pump",
    "temperature": "pump",
    "averaging": "averaging",
    "effective-actual": "effective_actual",
    "gain-influence": "gain_influence",
    "mallet": "mallet",
    "pedestal": "pedestal",
    "pedestal-damping": "pedestal_damping",
    "actuator-gain": "actuator_gain",
    "monitoring": "monitoring",
    "radial-mode": "radial",
    "eight-coefficients": "eight_coefficients",
    "appendix-c": "appendix_c",
    "direct-coefficients": "radial",
    "proportional-gain": "proportional_gain",
    "spinning": "spinning",
    "axial": "axial",
    "rising-stiffness": "rising_stiffness",
    "stiffness-causes": "stiffness_causes",
    "half-ripple": "self_sensing",
    "digital-filters": "self_sensing",
    "forward-path": "self_sensing",
    "estimator-tracking": "self_sensing",
    "estimator-response": "self_sensing",
    "band-pass": "self_sensing",
    "static-calibration": "self_sensing",
    "dynamic-calibration": "self_sensing",
    "lowest-rate": "self_sensing",
    "sphs": "schroeder",
}


def chosen(names: Sequence[str] = ()) -> list[Item]:
    """The named items, each once and in the order of the chapters; without names all of them.

    ValueError for a name that is not known.
    """
    unknown = [name for name in names if name not in HOME]
    if unknown:
        raise ValueError(f"item {unknown[0]!r} is unknown; known items: {', '.join(HOME)}")
    return [_item(name) for name in HOME if not names or name in names]


def _item(name: str) -> Item:
    module = import_module(f"maglev_workbench.commands.reproduce.chapters.{HOME[name]}")
    items = getattr(module, "ITEMS", None) or (module.ITEM,)
    return next(item for item in items if item.name == name)
