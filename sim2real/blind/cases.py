"""A sealed set on disk: its folders, the seal of its labels, the truth of each campaign, and the answer to it."""

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import Any

from maglev_env.loop.effect import EFFECTS

CAMPAIGNS, ANSWERS, LABELS, SEAL = "campaigns", "answers", "labels.json", "labels.sha256"
ANSWER_SCHEMA, DIAGNOSIS_SCHEMA = "maglev-blind-answer/1", "maglev-diagnosis/1"
KINDS = ("none", "single", "pair", "unknown")
VERDICTS = ("no_gap", "explained", "ambiguous", "unexplained")
NO_GAP, UNKNOWN = frozenset({"none"}), frozenset({"unknown"})
_CALIBRATION = frozenset({"calibration"})


@dataclass(frozen=True)
class Case:
    """The truth of one campaign.

    Attributes:
        id: Identity of the campaign.
        kind: One of KINDS.
        rig: Name of the rig.
        channels: Name of the channel set.
        effects: Names of its effects.
        size: Size in multiples of the detection threshold, of a pair the smaller one; None without an effect.
        speeds: Speeds of rotation of its recordings, rpm.
        label: The label as written.
    """

    id: str
    kind: str
    rig: str
    channels: str
    effects: frozenset[str]
    size: float | None
    speeds: frozenset[float]
    label: Mapping[str, Any]

    @property
    def truth(self) -> frozenset[str]:
        """The right hypothesis: the effects, or "none" or "unknown" alone."""
        return {"none": NO_GAP, "unknown": UNKNOWN}.get(self.kind, self.effects)


@dataclass(frozen=True)
class Hypothesis:
    """One entry of a diagnosis' `which`: its effects, its probability, and the values of "effect.parameter"."""

    effects: frozenset[str]
    probability: float
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Answer:
    """An answer to a campaign.

    Attributes:
        error: Why there is no diagnosis; None when there is one.
        verdict: The verdict.
        cause: Hypotheses of the verdict: one when explained, several when ambiguous, otherwise none.
        which: Every hypothesis with its probability.
        blocks: Share of the gap by block.
        closed_fraction: Share of the gap that the diagnosis closes.
        seconds: Duration of the diagnosis, s.
        version: Version of the code that gave it.
        changes: Relative changes of nominal parameters within tolerance that belong to the cause.
        likely: Hypotheses among which the truth is said to be in 90 % of all campaigns; None where that is not said.
        replaces: Versions of the code whose answers this one replaced.
    """

    error: str | None
    verdict: str
    cause: tuple[frozenset[str], ...]
    which: tuple[Hypothesis, ...]
    blocks: Mapping[str, float]
    closed_fraction: float
    seconds: float
    version: str
    changes: Mapping[str, float] = field(default_factory=dict)
    likely: tuple[frozenset[str], ...] | None = None
    replaces: tuple[str, ...] = ()


def named(effects: Iterable[str]) -> frozenset[str]:
    """A hypothesis of a diagnosis as a truth is named. "calibration" is "none": a real rig is never exactly nominal."""
    names = frozenset(effects)
    return NO_GAP if names == _CALIBRATION else names


def seal_of(folder: Path) -> str:
    """SHA-256 of the labels, written when the set was made, to be published before any answer.

    Raises:
        ValueError: The folder holds no sealed set.
    """
    path = folder / SEAL
    if not path.is_file():
        raise ValueError(f"{folder} holds no {SEAL}: make a sealed set there first (maglev blind generate)")
    return path.read_text().split()[0]


def open_labels(folder: Path) -> tuple[Case, ...]:
    """The truth of every campaign.

    Raises:
        ValueError: The labels are not the sealed ones, or are incomplete.
    """
    raw = (folder / LABELS).read_bytes()
    if (found := sha256(raw).hexdigest()) != seal_of(folder):
        raise ValueError(f"{folder / LABELS} has the SHA-256 {found}, not that in {SEAL}: it was changed")
    return tuple(_case(folder, label) for label in json.loads(raw))


def answers_digest(folder: Path, cases: Sequence[Case]) -> str:
    """SHA-256 of the answers to all cases, in their order."""
    return sha256(b"".join((folder / ANSWERS / f"{case.id}.json").read_bytes() for case in cases)).hexdigest()


def _case(folder: Path, label: Mapping[str, Any]) -> Case:
    where = f"{folder / LABELS}: campaign {label.get('id')!r}"
    for key in ("id", "kind", "rig", "channels", "effects", "sizes"):
        if key not in label:
            raise ValueError(f"{where} lacks {key!r}")
    if label["kind"] not in KINDS:
        raise ValueError(f"{where}: kind {label['kind']!r} is not one of {', '.join(KINDS)}")
    if label["kind"] in ("single", "pair") and (other := set(label["effects"]) - set(EFFECTS)):
        raise ValueError(f"{where}: effect {sorted(other)[0]!r} is not in the vocabulary")
    if not all(isfinite(size) and size > 0 for size in label["sizes"]):
        raise ValueError(f"{where}: sizes {label['sizes']} must be multiples of the threshold, above 0")
    toml = tomllib.loads((folder / CAMPAIGNS / label["id"] / "campaign.toml").read_text())
    speeds = frozenset(float(r.get("speed_rpm", 0.0)) for r in toml["recording"])
    size = min(label["sizes"], default=None)
    effects = frozenset(label["effects"])
    # An effect that was in no library when the set was made, and is in this one, can be named.
    kind = "single" if label["kind"] == "unknown" and effects <= EFFECTS.keys() else label["kind"]
    return Case(label["id"], kind, label["rig"], label["channels"], effects, size, speeds, label)


def read_answer(path: Path, seal: str) -> Answer:
    """Read one answer.

    Raises:
        ValueError: It is missing, or was given to another sealed set.
    """
    if not path.is_file():
        raise ValueError(f"{path} is missing: every campaign must be answered first (maglev blind answer)")
    data = json.loads(path.read_text())
    if data.get("schema") != ANSWER_SCHEMA or data.get("labels_sha256") != seal:
        raise ValueError(f"{path} does not answer this sealed set; delete it and answer again")
    if "error" in data:
        answer = Answer(data["error"], "error", (), (), {}, 0.0, data["seconds"], data["version"])
    else:
        answer = parse_diagnosis(data["diagnosis"], data["seconds"], data["version"])
    return replace(answer, replaces=tuple(data.get("replaces", ())))


def parse_diagnosis(d: Mapping[str, Any], seconds: float, version: str) -> Answer:
    """A diagnosis (schema maglev-diagnosis/1, as JSON data) as an answer.

    Raises:
        ValueError: The diagnosis is not valid; the message says why.
    """
    if d.get("schema") != DIAGNOSIS_SCHEMA or d.get("verdict") not in VERDICTS:
        raise ValueError(
            f"diagnosis: schema {d.get('schema')!r}, verdict {d.get('verdict')!r}; "
            f"use {DIAGNOSIS_SCHEMA} and one of {', '.join(VERDICTS)}"
        )
    verdict, names = d["verdict"], d["cause"]
    known = {"none", "calibration", "unknown", *EFFECTS}
    which = []
    for entry in d["which"]:
        values = {key: float(v["value"]) for key, v in entry.get("parameters", {}).items()}
        effects, probability = frozenset(entry["effects"]), float(entry["probability"])
        if not effects or effects - known or not 0 <= probability <= 1:
            raise ValueError(f"diagnosis: which holds {sorted(effects)} with probability {probability}")
        which.append(Hypothesis(effects, probability, values))
    if not which or abs(sum(h.probability for h in which) - 1) > 1e-3:
        raise ValueError("diagnosis: the probabilities of `which` must sum to one")
    cause = {
        "explained": (frozenset(names),),
        "ambiguous": tuple(frozenset(member.split("+")) for member in names),
    }.get(verdict, ())
    if any(not one or one - set(EFFECTS) for one in cause) or (verdict == "ambiguous" and not cause):
        raise ValueError(f"diagnosis: cause {names} of verdict {verdict} must name known effects")
    closed = d["gap"].get("closed_fraction")
    return Answer(
        None,
        verdict,
        cause,
        tuple(which),
        {str(k): float(v) for k, v in d["where"]["blocks"].items()},
        0.0 if closed is None else float(closed),
        seconds,
        version,
        {str(k): float(v) for k, v in d.get("corrected", {}).get("changes", {}).items()},
        tuple(frozenset(one) for one in d["likely"]["hypotheses"]) if d.get("likely") else None,
    )
