"""`maglev check`."""
