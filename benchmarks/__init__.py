"""Speed, measured as ratios to references that run in the same process."""
