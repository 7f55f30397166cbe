"""Columns of a single data file, as options on the command line name them."""

from math import isfinite

from maglev_env.recordings.campaign_tables import ChannelSource


def column_source(text: str) -> ChannelSource:
    """The source of a channel from the text `name` or `name*scale`.

    Raises:
        ValueError: The scale is not a number other than zero.
    """
    name, star, factor = text.rpartition("*")
    if not star:
        return ChannelSource((text,), (1.0,), 1.0, 0.0)
    try:
        scale = float(factor)
    except ValueError:
        raise ValueError(f"column {text!r}: write name or name*scale") from None
    if not (isfinite(scale) and scale):
        raise ValueError(f"column {text!r}: the scale must be a number other than zero")
    return ChannelSource((name,), (1.0,), scale, 0.0)
