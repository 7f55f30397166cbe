"""Coil current in, air gap out. Knows no rig. Each module is imported from its own name."""
