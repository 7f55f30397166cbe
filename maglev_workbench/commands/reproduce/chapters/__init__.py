"""The dissertation's experiments, a file each."""
