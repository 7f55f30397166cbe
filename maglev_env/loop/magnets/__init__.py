"""Force laws of the magnets, their energy, and the checks of their parameters."""
