"""What a data file of unknown origin holds, guessed with evidence: one file for each idea."""
