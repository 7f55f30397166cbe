"""References: the best linear controllers of a kind that a rig's model allows, to hold tuned gains against."""
