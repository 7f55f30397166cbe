"""`maglev simulate`."""
