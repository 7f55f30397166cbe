"""`maglev blind score`."""
