"""Searches for gains: they ask for experiments, and are told what these found."""
