"""`maglev blind next`."""
