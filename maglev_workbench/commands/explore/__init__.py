"""`maglev explore`."""
