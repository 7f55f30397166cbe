"""`maglev blind generate`."""
