"""The gap: where it lies, how far it shrinks, and what is left of it."""
