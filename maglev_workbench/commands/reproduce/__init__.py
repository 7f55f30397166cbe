"""`maglev reproduce`."""
