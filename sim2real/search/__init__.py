"""Which effect explains what is left: hypotheses, their fits and the search among them."""
