"""`maglev selfsense demodulate`."""
