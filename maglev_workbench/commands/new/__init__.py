"""`maglev new`."""
