"""Free corrections of a block, where no known effect explains the gap: what they are, their fit, and their shape."""
