"""`maglev selfsense design`."""
