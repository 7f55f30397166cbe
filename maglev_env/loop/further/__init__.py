"""Further effects of every block: what is compiled into a step only where a lane has one of them."""
