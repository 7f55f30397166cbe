"""A public benchmark of diagnoses: sealed campaigns by a generator of its own, an oracle, and the scores of methods."""
