"""What a request costs, told before any work.

A typing error must end in a sentence, not in hours of silence or in a process that the system ends for its memory.
"""

MOST_EXPERIMENTS = 1_000_000  # results of some 1.5 kB each, in memory together or in a file
MOST_SECONDS = 30 * 86400.0  # s on one core
MOST_SAMPLES = 40_000_000  # of one experiment: 33 minutes at 20 kHz
MOST_IN_PERIOD = 4_000_000  # a period of all lanes that run together is in memory, 512 bytes for a sample
MOST_BYTES = 1024**3  # of a recording: also the limit of files that are read
SPEED = 1.5e7  # samples per second on one core, as measured with many experiments at a time
_UNITS = ((365.25 * 86400, "years"), (86400, "days"), (3600, "hours"), (60, "minutes"), (1, "seconds"))


def check_experiments(count: int, samples: float, what: str) -> None:
    """Check the number of experiments of a request and the time that they take.

    Args:
        count: Number of experiments.
        samples: Control samples of each.
        what: Says which options ask for them.

    Raises:
        ValueError: They are too many; the message says how long they would take.
    """
    seconds = count * samples / SPEED
    if count > MOST_EXPERIMENTS or seconds > MOST_SECONDS:
        time = f" of {samples:.4g} samples take about {duration(seconds)} on one core and" if samples else " take"
        raise ValueError(
            f"{what}: {count:.4g} experiments{time} {1.5e3 * count / 1e9:.2g} GB of memory; the limit is "
            f"{MOST_EXPERIMENTS} experiments and {duration(MOST_SECONDS)}: ask for fewer"
        )


def check_length(period: float, periods: int, what: str) -> None:
    """Check the length of one experiment.

    Args:
        period: Control samples in a period.
        periods: Number of periods, transients included.
        what: Says where they are asked for.

    Raises:
        ValueError: It is too long; the message says how long it would be.
    """
    if period > MOST_IN_PERIOD:
        raise ValueError(
            f"{what}: a period has {period:.4g} samples, which take {512 * period / 1e9:.3g} GB of memory; the limit "
            f"is {MOST_IN_PERIOD} samples: choose a higher fundamental"
        )
    if period * periods > MOST_SAMPLES:
        raise ValueError(
            f"{what}: {periods} periods of {period:.6g} samples are {period * periods:.4g}; the limit is "
            f"{MOST_SAMPLES} samples: ask for fewer periods"
        )


def check_bytes(size: float, what: str) -> None:
    """Raise ValueError if a recording of `size` bytes is larger than what can be read again."""
    if size > MOST_BYTES:
        raise ValueError(
            f"{what}: it would hold {size / 1e9:.3g} GB; the limit is {MOST_BYTES / 1e9:.3g} GB: record less"
        )


def duration(seconds: float) -> str:
    """A time in words, in its largest unit."""
    size, unit = next(((s, u) for s, u in _UNITS if seconds >= s), _UNITS[-1])
    return f"{seconds / size:.2g} {unit}"
