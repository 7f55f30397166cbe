"""`maglev selfsense levitate`."""
