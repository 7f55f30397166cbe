"""`maglev bench`."""
