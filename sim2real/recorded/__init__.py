"""What the recordings of a campaign say: read, with what drove them, and opened at the nominal loop."""
