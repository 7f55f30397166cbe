"""`maglev export`."""
