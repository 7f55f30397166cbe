"""Chapter 6: self-sensing."""
