"""Columns with a reversed sign that no single comparison shows: of one probe in a sum, of one input of a controller."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.redundancy.finding import Finding


def reversed_columns(spec: RecordingSpec, agrees: Callable[[RecordingSpec, tuple[str, ...]], bool]) -> list[Finding]:
    """The one change of sign under which all comparisons agree.

    Args:
        spec: The recording.
        agrees: Whether they all do with a changed recording, and one of them is of these channels.
    """
    for channel, text, changed in _changes(spec):
        if agrees(changed, tuple(channel.split(" or "))):
            text += ": the other way round every comparison agrees; correct [recording.channels]"
            return [Finding("sign", spec.name, channel, -1.0, None, text, "contradiction")]
    return []


def _changes(spec: RecordingSpec) -> Iterator[tuple[str, str, RecordingSpec]]:
    """Channels, words and the changed recording, for each sign that is tried."""
    sums = {name: source for name, source in spec.channels.items() if len(source.columns) > 1}
    for column in dict.fromkeys(c for source in sums.values() for c in source.columns):
        of = {name: source for name, source in sums.items() if column in source.columns}
        turned = {
            name: replace(source, weights=tuple(-w if c == column else w
                                                for w, c in zip(source.weights, source.columns, strict=True)))
            for name, source in of.items()
        }  # fmt: skip
        text = f"{' and '.join(of)}: the sign of column {column!r} is reversed against the other columns of its sum"
        yield " or ".join(of), text, replace(spec, channels={**spec.channels, **turned})
    for name in [n for n in spec.channels if n.partition("_")[0] == "displacement"]:
        wanted = name.replace("displacement", "reference")
        for names in ([name], [name, wanted]) if wanted in spec.channels else ([name],):
            own = {n: spec.channels[n] for n in names}
            turned = {n: replace(source, scale=-source.scale, offset=-source.offset) for n, source in own.items()}
            columns = " and ".join(repr(source.expression) for source in own.values())
            text = f"{' and '.join(names)}: the sign of {columns} is reversed"
            yield " or ".join(names), text, replace(spec, channels={**spec.channels, **turned})
