"""`maglev blind open`."""
