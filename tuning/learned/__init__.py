"""Tuners that were trained: policies from what experiments have said so far to the gains to try next."""
