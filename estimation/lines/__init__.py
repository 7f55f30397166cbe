"""From records to the statistics of their spectral lines."""
