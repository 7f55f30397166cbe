"""`maglev blind learn`."""
