"""Periodic multisines: their lines, phases and crest."""
