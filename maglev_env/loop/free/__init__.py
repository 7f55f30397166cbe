"""Free corrections: curves and memories of no particular physics, compiled in only where a lane has one of them."""
