"""`maglev selfsense rivals`."""
