"""Text of files from elsewhere as a terminal may be given it."""

import re

# What a terminal obeys instead of showing (all but line break and tab), and what turns the order of letters around.
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    """The text with the sign of replacement, U+FFFD, for each character that would command the terminal."""
    return _OBEYED.sub("\ufffd", text)
