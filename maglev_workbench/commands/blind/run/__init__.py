"""`maglev blind run`."""
