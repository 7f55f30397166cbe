"""Coil current in, air gap out. Knows no rig."""

from selfsense.coil import coil_inductance

__all__ = ["coil_inductance"]
