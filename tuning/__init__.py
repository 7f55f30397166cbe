"""What chooses gains: tuners, sweeps, studies, campaigns and comparisons."""
