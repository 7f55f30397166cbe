"""`maglev runup`."""
