"""What to believe: probabilities, verdict, and evidence that no fit of lines sees."""
