"""Sealed campaigns with known causes, from a twin that shares no code, integrator or model form with the simulator."""
