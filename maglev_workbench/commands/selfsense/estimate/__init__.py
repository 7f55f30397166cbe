"""`maglev selfsense estimate`."""
