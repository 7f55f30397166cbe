"""The loop, block by block: effects, gains, axes, magnets, sensors."""
