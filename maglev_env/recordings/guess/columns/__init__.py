"""Which column of a file is which channel, and in which unit."""
