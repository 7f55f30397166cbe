"""Common parts of all lane simulations: layout, noise addressed by seed, threads, processes, matrix exponentials."""
