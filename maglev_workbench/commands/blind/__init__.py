"""`maglev blind`."""
