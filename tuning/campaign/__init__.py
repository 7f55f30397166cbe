"""Tuning a real rig from its recordings, one experiment at a time."""
