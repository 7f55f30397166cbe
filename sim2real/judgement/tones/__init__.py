"""What tones in recordings say: where they are seen, how large they are, and which hypotheses explain them."""
