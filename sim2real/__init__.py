"""A campaign of recordings in, a diagnosis out: where the gap lies, what causes it, how far it closes."""
