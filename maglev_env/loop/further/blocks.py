"""The files of the further effects, in the order of their rows; the last one's END is where the rows end."""

from maglev_env.loop.further import command_path, probe_play, springs, uneven_gain, vibration

BLOCKS = (command_path, uneven_gain, springs, probe_play, vibration)
END = BLOCKS[-1].END
NAMES = frozenset(name for block in BLOCKS for name in block.EFFECTS)
