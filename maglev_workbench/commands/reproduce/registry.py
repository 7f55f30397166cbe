"""The experiments by name, in the order of the dissertation's chapters; their modules are imported on demand."""

from collections.abc import Sequence
from importlib import import_module

from maglev_workbench.commands.reproduce.item import Item

# Name on the command line -> module of this package that holds it.
HOME = {
    "hydraulics": "bearing.hydraulics",
    "bearing-coefficients": "bearing.bearing_design",
    "flux-map": "bearing.flux_map",
    "stability-conditions": "bearing.bearing_design",
    "motor": "bearing.motor_drive",
    "levitation": "bearing.pump",
    "run-up": "bearing.pump",
    "coil-current": "bearing.pump",
    "axial-force": "bearing.pump",
    "temperature": "bearing.pump",
    "laminations": "bearing.laminations",
    "averaging": "identification.averaging",
    "effective-actual": "identification.effective_actual",
    "gain-influence": "identification.gain_influence",
    "mallet": "identification.mallet",
    "pedestal": "coefficients.pedestal",
    "pedestal-damping": "coefficients.pedestal_damping",
    "actuator-gain": "coefficients.actuator_gain",
    "monitoring": "coefficients.monitoring",
    "radial-mode": "coefficients.radial",
    "eight-coefficients": "coefficients.eight_coefficients",
    "appendix-c": "coefficients.appendix_c",
    "direct-coefficients": "coefficients.radial",
    "proportional-gain": "coefficients.proportional_gain",
    "spinning": "coefficients.spinning",
    "axial": "coefficients.axial",
    "rising-stiffness": "identification.rising_stiffness",
    "stiffness-causes": "coefficients.stiffness_causes",
    "half-ripple": "self_sensed.self_sensing",
    "digital-filters": "self_sensed.self_sensing",
    "forward-path": "self_sensed.self_sensing",
    "estimator-tracking": "self_sensed.self_sensing",
    "estimator-response": "self_sensed.self_sensing",
    "band-pass": "self_sensed.self_sensing",
    "static-calibration": "self_sensed.self_sensing",
    "dynamic-calibration": "self_sensed.self_sensing",
    "lowest-rate": "self_sensed.self_sensing",
    "future-work": "bearing.future",
    "pump-on-coils": "self_sensed.pump_on_coils",
    "thrust": "bearing.thrust",
    "sphs": "identification.schroeder",
}


def require_known(names: Sequence[str]) -> None:
    """Check that these are names of items.

    Raises:
        ValueError: One is not; the message lists those that are.
    """
    unknown = [name for name in names if name not in HOME]
    if unknown:
        raise ValueError(f"item {unknown[0]!r} is unknown; known items: {', '.join(HOME)}")


def chosen(names: Sequence[str] = ()) -> list[Item]:
    """The named items, each once and in the order of the chapters; without names all of them.

    Raises:
        ValueError: A name is not known.
    """
    require_known(names)
    return [_item(name) for name in HOME if not names or name in names]


def _item(name: str) -> Item:
    module = import_module(f"maglev_workbench.commands.reproduce.chapters.{HOME[name]}")
    items = getattr(module, "ITEMS", None) or (module.ITEM,)
    return next(item for item in items if item.name == name)
