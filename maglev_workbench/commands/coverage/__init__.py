"""The command `maglev coverage`."""
