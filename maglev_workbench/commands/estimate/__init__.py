"""`maglev estimate`."""
