"""Chapter 5: stiffness and damping of the pump's bearings."""
