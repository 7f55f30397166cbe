"""`maglev selfsense robustness`."""
