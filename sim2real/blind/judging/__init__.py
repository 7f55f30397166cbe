"""What the answers to an opened set are worth: each is judged against the truth, and all are counted."""
