"""Calibration of a gap sensor, recorded or simulated: its static line and its response to motion."""
