"""Recordings and campaigns: files, channels, spectra, quality."""
