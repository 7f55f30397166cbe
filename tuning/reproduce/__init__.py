"""The dissertation's experiments, run anew: what was published, what this workbench finds, and why they differ."""
