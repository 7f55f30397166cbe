"""`maglev selfsense calibrate`."""
