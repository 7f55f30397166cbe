"""What a campaign is compared by: simulations of its recordings, and residuals in units of their noise."""
