"""Chapter 3: the bearing, the motor and the pump."""
