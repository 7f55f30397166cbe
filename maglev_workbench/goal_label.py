"""What the default folder of a result adds for a goal, so that one goal after another finds a folder of its own."""

from hashlib import sha256
from pathlib import Path

DIGITS = 6  # of the hash of a goal's requirements


def goal_label(source: str | None) -> str:
    """The end of a default folder's name, such as -engineer or -compliance-1f2e3d; "" where no goal is given.

    Args:
        source: What `--goal` gives: a name, a text file, or the requirements themselves. The same requirements have the
            same label, however they are written; those of a file begin with its name, others with what is made best.

    Raises:
        ValueError: The goal is not understood.
        OSError: The file cannot be read.
    """
    if source is None:
        return ""
    from maglev_env.design.goals import goal_text
    from maglev_env.rig.goal import NAMED, parse_goal

    text = goal_text(source)
    if text.strip() in NAMED:
        return f"-{text.strip()}"
    goal = parse_goal(text)
    first = Path(source).stem if text != source else (goal.best or goal.requirements[0]).name
    return f"-{first}-{sha256(goal.text.encode()).hexdigest()[:DIGITS]}"
