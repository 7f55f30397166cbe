"""What every lane simulation shares: noise addressed by seed, threads, processes and workers, matrix exponentials."""
