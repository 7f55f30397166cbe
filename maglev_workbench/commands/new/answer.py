"""The answer of `maglev new`: what was read, what must be edited, and what is to be confirmed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from maglev_env.recordings.guess.recording import ALARM, RecordingGuess
from maglev_env.recordings.guess.suspended import TOTAL
from maglev_workbench.commands.new.stated import Stated

TAKEN, TAKEN_FOR = "whether this column is the ", "what columns are taken for"
SCALE = "scale in"  # how the point begins of a column whose numbers are in no unit of its channel
MOST_NAMED = 8  # columns or files of one point; each stands in campaign.toml
_RIG = "rig.toml: what is marked there; then take the # from rig in campaign.toml (diagnose needs it)"
_RIG_AGAIN = (
    "; of what hangs below a magnet rather this command again with --rig and --force, which then states the bias in "
    "its current and the gap of its position"
)
_RIG_KEPT = "rig.toml is filled in, and kept: this command again with --rig and --force, or take the # from rig"
_RIG_FAULT = "rig.toml is not as this command writes it, and is kept, but is no rig yet: {}"
_OPTIONS = " (--scale COLUMN=VALUE, and --zero COLUMN=READING; the gains follow)"


@dataclass(frozen=True)
class Answer:
    """What is said of files that became a campaign.

    Attributes:
        sentence: How many files were read, and what must be edited before the next command.
        edit: What no command can do without, or does much better with.
        confirm: What campaign.toml asks for, each point once with its columns and files.
        alarms: File and fault.
    """

    sentence: str
    edit: tuple[str, ...]
    confirm: tuple[str, ...]
    alarms: tuple[str, ...]


def answer_of(
    guesses: Sequence[RecordingGuess],
    refused: Mapping[Path, str],
    stated: Stated,
    skeleton: bool,
    filled: bool = False,
    fault: str = "",
) -> Answer:
    """The answer.

    Args:
        guesses: one for each file that was read.
        refused: files that were left out, with the reason.
        stated: what the user said.
        skeleton: whether a rig.toml stands beside campaign.toml that is to be filled in.
        filled: whether it is filled in already, and was kept.
        fault: why it is no rig although somebody wrote into it; it was kept, too.
    """
    edit = [f"sample_rate of {g.file}: it is not known and stands as 0" for g in guesses if g.rate.value is None]
    unread = [f"columns of {g.file}: {_listed(g.unread)} could not be read" for g in guesses if g.unread]
    scaled = [point for point in _confirm(guesses) if point.startswith(SCALE)]
    must = [
        *(f"mend the columns of {g.file} that could not be read" for g in guesses if g.unread),
        *(f"state {point.partition(':')[0]}" for point in edit),
        *(["state the scales below"] if scaled else []),
    ]
    edit = unread + edit
    if skeleton:
        hangs = any(TOTAL in c.ask for g in guesses for c in g.columns)
        written = _RIG_FAULT.format(fault) if fault else f"{_RIG}{_RIG_AGAIN if hangs else ''}"
        edit.append(_RIG_KEPT if filled else written)
    if stated.mass is None and stated.rig is None:
        edit.append("mass: the moving mass in kg, if it is known (--mass)")
    files = len({g.file for g in guesses})  # one may hold several recordings
    read = f"Read {files} of {files + len(refused)} file(s)"
    before = f"{must[0]} before" if must else "nothing must be edited before"
    return Answer(f"{read}; {before} `maglev check`.", tuple(edit), tuple(_confirm(guesses)), tuple(_alarms(guesses)))


def rows(guesses: Sequence[RecordingGuess]) -> list[tuple[str, ...]]:
    """File, channels with their columns, rate, excitation, and the samples that are used."""
    found = []
    for g in guesses:
        channels = ", ".join(f"{name} {c.label}" for name, c in g.channels.items() if name != "time")
        rate = "?" if g.rate.value is None else f"{g.rate.value:.6g}"
        driven = g.excitation.value if isinstance(g.excitation.value, str) else "periodic"
        part = f"{g.part[0]} .. {g.part[0] + g.part[1]}" if g.part else "all"
        found.append((g.file, channels, rate, driven, part))
    return found


HEAD = ("file", "channels and columns", "Hz", "excitation", "samples")


def _confirm(guesses: Sequence[RecordingGuess]) -> list[str]:
    """Each point that the files ask for, once, with what it concerns."""
    points: dict[str, dict[str, None]] = {}
    for g in guesses:
        for one in g.guesses:
            column = one.what.removeprefix("column ") if one.what.startswith("column ") else None
            for point in filter(None, one.ask.split("; ") if column else [one.ask]):
                taken = point.removeprefix(TAKEN)
                about = f"{column} as {taken}" if taken != point else column or g.file
                points.setdefault(TAKEN_FOR if taken != point else point, {})[about] = None
    found = []
    for point, about in points.items():
        everywhere = set(about) == {g.file for g in guesses}
        named = [*about][:MOST_NAMED]
        more = f" and {len(about) - len(named)} more" if len(about) > len(named) else ""
        point += _OPTIONS if point.startswith(SCALE) else ""
        found.append(point if everywhere else f"{point}: {', '.join(named)}{more}")
    return found


def _listed(unread: Mapping[str, str]) -> str:
    """Columns that could not be read, the first with its reason."""
    (first, why), *others = unread.items()
    return ", ".join([f"{first} ({why})", *(name for name, _ in others[: MOST_NAMED - 1])])


def _alarms(guesses: Sequence[RecordingGuess]) -> list[str]:
    said = [f"{g.file}: {note.removeprefix(ALARM)}" for g in guesses for note in g.notes if note.startswith(ALARM)]
    return [*dict.fromkeys(said)]
