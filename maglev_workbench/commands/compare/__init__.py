"""`maglev compare`."""
