"""`maglev diagnose`."""
