"""`maglev selfsense`."""
