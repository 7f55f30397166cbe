"""`maglev effects`."""
