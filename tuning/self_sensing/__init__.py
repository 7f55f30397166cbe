"""What the `maglev selfsense` commands do and show."""
