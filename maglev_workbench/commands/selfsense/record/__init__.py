"""`maglev selfsense record`."""
