"""`maglev train`."""
