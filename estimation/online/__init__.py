"""Estimates that follow a running rig."""
