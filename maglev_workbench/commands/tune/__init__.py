"""`maglev tune`."""
