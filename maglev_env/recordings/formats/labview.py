"""LabVIEW's .lvm: with "Multi_Headings" every packet of samples has a heading of its own above it.

Format: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from collections.abc import Iterable, Iterator

from maglev_env.recordings.formats.file_formats import Refused

_FIRST, _PACKET, _END = "LabVIEW Measurement", "Channels", "***End_of_Header***"


def numbered_lines(file: Iterable[str]) -> Iterator[tuple[int, str]]:
    """The lines of a text file with their numbers from 1; of LabVIEW's only the first packet's heading.

    Args:
        file: The lines.

    Raises:
        Refused: A later packet has other columns.
    """
    names, above, heading, labview = "", "", False, False
    blanks: list[tuple[int, str]] = []
    for number, line in enumerate(file, 1):
        labview = labview or (number == 1 and line.startswith(_FIRST))
        ended, above = above.startswith(_END), line
        if not labview or not names:
            yield number, line
            if labview and ended and line.strip() and not line.startswith(_PACKET):
                names = line.strip()
        elif heading:
            heading = not ended
            if ended and line.strip() != names:
                raise Refused(f"line {number} names other columns than the first packet; give each its own file")
        elif line.startswith(_PACKET):
            heading, blanks = True, []
        elif not line.strip():
            blanks.append((number, line))
        else:
            yield from (*blanks, (number, line))
            blanks = []
    yield from blanks
