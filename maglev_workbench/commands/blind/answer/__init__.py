"""`maglev blind answer`."""
