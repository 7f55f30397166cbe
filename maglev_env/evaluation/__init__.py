"""From simulated or recorded experiments to coefficients, margins and score."""
