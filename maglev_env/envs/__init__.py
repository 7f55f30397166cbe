"""Gymnasium environments: PID gains are the action; identified stiffness, damping and stability the observation."""
