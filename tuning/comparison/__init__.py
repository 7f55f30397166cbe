"""Tuners compared on rigs that none of them has seen."""
