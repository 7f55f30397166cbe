"""`maglev selfsense rate-limit`."""
