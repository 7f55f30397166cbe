"""The linearised loop: states, exact sampled-data responses, poles."""
