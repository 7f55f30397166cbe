"""`maglev selfsense noise`."""
