"""A policy over stacked observations, and its checkpoints, which hold numbers and text only."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from maglev_env.recordings.files import atomic_file
from maglev_env.task.task import Tuning
from tuning.learned.familiar import Familiar

SCHEMA = "maglev-policy/1"
FAMILIAR = "familiar_"  # begins the names of what training saw, in a checkpoint
MOST_BYTES = 16_000_000  # largest unpacked checkpoint


@dataclass(frozen=True)
class Shape:
    """What a policy reads and sets.

    Attributes:
        names: Names of one observation's elements.
        gains: Gains that an action sets.
        ends: Lowest and highest value of each gain, SI.
        history: Number of stacked observations.
        width: Width of the two hidden layers.
    """

    names: tuple[str, ...]
    gains: tuple[str, ...]
    ends: tuple[tuple[float, float], ...]
    history: int = 10
    width: int = 192

    @property
    def inputs(self) -> int:
        return self.history * (len(self.names) + 1)


def shape_for(task: Tuning, history: int, width: int) -> Shape:
    """The shape of a policy for a task's observations and gains."""
    ends = tuple(zip(map(float, task.box.low), map(float, task.box.high), strict=True))
    return Shape(tuple(task.layout.names), tuple(task.box.names), ends, history, width)


class HistoryPolicy(nn.Module):
    """From stacked observations (n, inputs) to points (n, k) of the box [-1, 1]^k.

    The newest observation comes first. Each is followed by 1; empty places hold zeros and a 0.

    Attributes:
        shape: What it reads and sets.
        familiar: What the observations of its training have in common; None: nobody knows.
    """

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        self.familiar: Familiar | None = None
        self.net = nn.Sequential(
            nn.Linear(shape.inputs, shape.width), nn.ReLU(),
            nn.Linear(shape.width, shape.width), nn.ReLU(),
            nn.Linear(shape.width, len(shape.gains)), nn.Tanh(),
        )  # fmt: skip

    def forward(self, stacked: torch.Tensor) -> torch.Tensor:
        return self.net(stacked)

    @property
    def digest(self) -> str:
        """SHA-256 of all that it acts by: its shape, its weights and what is familiar to it."""
        arrays = [value.numpy() for value in self.state_dict().values()]
        arrays += [] if self.familiar is None else vars(self.familiar).values()
        head = json.dumps(asdict(self.shape)).encode()
        return sha256(b"".join([head, *(np.ascontiguousarray(one).tobytes() for one in arrays)])).hexdigest()

    def act(self, observations: np.ndarray) -> np.ndarray:
        """Points (n, k) from observations (n, t, size), oldest first; the newest `history` of them are used."""
        with torch.no_grad():
            return self(torch.from_numpy(stack(observations, self.shape.history))).numpy().astype(float)


def stack(observations: np.ndarray, history: int) -> np.ndarray:
    """Observations (n, t, size), oldest first, as inputs (n, history (size + 1)) of a policy, float32."""
    n, _, size = observations.shape
    kept = observations[:, ::-1][:, :history]
    found = np.zeros((n, history, size + 1), np.float32)
    found[:, : kept.shape[1], :size] = kept
    found[:, : kept.shape[1], size] = 1.0
    return found.reshape(n, -1)


def save_policy(path: Path, policy: HistoryPolicy, made_by: Mapping[str, Any]) -> None:
    """Write a checkpoint atomically: weights as arrays, shape and origin as JSON text."""
    head = json.dumps({"schema": SCHEMA, "shape": asdict(policy.shape), "made_by": made_by}, allow_nan=False)
    weights = {name: value.numpy() for name, value in policy.state_dict().items()}
    if policy.familiar is not None:
        weights |= {f"{FAMILIAR}{name}": value for name, value in vars(policy.familiar).items()}
    with atomic_file(path) as file:
        np.savez(file, head=np.frombuffer(head.encode(), np.uint8), **weights)


def load_policy(path: Path) -> tuple[HistoryPolicy, dict[str, Any]]:
    """Read a checkpoint. Nothing in it is executed; pickled contents are refused.

    Returns:
        The policy and its origin.

    Raises:
        ValueError: It is not a checkpoint, is damaged, too large, or of another schema.
        OSError: It cannot be read.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: not a regular file; name a policy file")
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(part.file_size for part in archive.infolist()) > MOST_BYTES:
                raise ValueError(f"unpacks to more than {MOST_BYTES} bytes")
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        head = json.loads(arrays.pop("head").tobytes())
        if head["schema"] != SCHEMA:
            raise ValueError(f"schema {head['schema']!r}, not {SCHEMA!r}")
        s, made_by = head["shape"], dict(head["made_by"])
        ends = tuple((float(low), float(high)) for low, high in s["ends"])
        shape = Shape(tuple(s["names"]), tuple(s["gains"]), ends, int(s["history"]), int(s["width"]))
        if 4 * shape.width * max(shape.inputs, shape.width) > MOST_BYTES:
            raise ValueError(f"width {shape.width} and {shape.inputs} inputs take more than {MOST_BYTES} bytes")
        if shape.history < 2:
            raise ValueError(f"history {shape.history}, of which 2 is the least")
        policy = HistoryPolicy(shape)
        own = {name.removeprefix(FAMILIAR): arrays.pop(name) for name in [*arrays] if name.startswith(FAMILIAR)}
        policy.familiar = Familiar(**own) if own else None
        policy.load_state_dict({name: torch.from_numpy(value) for name, value in arrays.items()})
        _check_numbers(policy)
    except OSError:
        raise
    except Exception as error:  # a foreign file can make the libraries raise almost anything
        raise ValueError(f"{path}: not a policy of this workbench ({error})") from None
    return policy.eval(), made_by


def _check_numbers(policy: HistoryPolicy) -> None:
    """Raise ValueError unless all numbers of a policy are finite, and those of what is familiar to it have its size."""
    if not all(bool(torch.isfinite(value).all()) for value in policy.state_dict().values()):
        raise ValueError("its weights are not all finite")
    if policy.familiar is None:
        return
    n = len(policy.shape.names)
    for (name, value), size in zip(vars(policy.familiar).items(), ((n,), (n, n), ()), strict=True):
        if value.shape != size or not np.isfinite(value).all():
            raise ValueError(f"{FAMILIAR}{name} is not {size} finite numbers")
