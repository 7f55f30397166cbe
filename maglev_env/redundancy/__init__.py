"""Redundancy: what a recording says twice is compared, before anything is identified from it."""
