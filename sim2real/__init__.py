"""Sim-to-real diagnosis: from a campaign of recordings to where the gap lies, what causes it and how far it closes."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim2real.corrected import corrected_rig as corrected_rig
    from sim2real.corrected import write_corrected as write_corrected
    from sim2real.diagnosis import diagnose as diagnose
    from sim2real.result import Diagnosis as Diagnosis

_HOME = {
    "Diagnosis": "result",
    "diagnose": "diagnosis",
    "corrected_rig": "corrected",
    "write_corrected": "corrected",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
