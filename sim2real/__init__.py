"""Sim-to-real diagnosis: from a campaign of recordings to where the gap lies, what causes it and how far it closes."""

from importlib import import_module
from typing import Any

_HOME = {
    "Diagnosis": "diagnosis",
    "diagnose": "diagnosis",
    "corrected_rig": "corrected",
    "write_corrected": "corrected",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
