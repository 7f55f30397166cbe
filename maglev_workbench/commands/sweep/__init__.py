"""`maglev sweep`."""
