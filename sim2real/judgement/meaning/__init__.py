"""Whether a fitted effect may have its name: its parameters, limits and lines must mean what the name says."""
