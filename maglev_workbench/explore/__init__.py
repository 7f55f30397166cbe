"""The page of `maglev explore`: sliders for gains and effects, and the loop's answer at once."""
