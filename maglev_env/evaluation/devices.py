"""Where identification experiments are simulated: on this machine's processors, or on its GPU."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from maglev_env.experiment import Experiment
    from maglev_env.kernel.blocks import Block
    from maglev_env.kernel.simulate import Gathered

DEVICES = ("cpu", "cuda")
ON_GPU = 8192  # experiments that a GPU simulates at a time


@dataclass(frozen=True)
class Prepared:
    """Experiments with their lanes.

    Args:
        experiments: the experiments.
        blocks: their lanes, see `simulate.own_lanes`.
        gathered: what was simulated of them already; None: nothing.
    """

    experiments: "Sequence[Experiment]"
    blocks: "Sequence[Block]"
    gathered: "Sequence[Gathered] | None" = None


def require_device(device: str, sensor: str = "probe") -> str:
    """The device's own name.

    Raises:
        ValueError: It is not one of DEVICES, is not there, or cannot simulate experiments with this sensor.
    """
    if device not in DEVICES:
        raise ValueError(f"--device {device}: use one of {', '.join(DEVICES)}")
    if device == "cpu":
        return device
    if sensor != "probe":
        raise ValueError("--device cuda: self-sensing is not simulated on a GPU; use --device cpu")
    from maglev_lanes.gpu import require_gpu

    return require_gpu()


def simulated_groups(
    chunks: Sequence[slice],
    prepared: Callable[[slice], list[Prepared]],
    device: str,
    empty: Callable[[tuple[int, ...]], np.ndarray] = np.empty,
) -> Iterator[list[tuple[slice, list[Prepared]]]]:
    """Chunks of experiments with what was simulated of them on a GPU, ON_GPU experiments at a time.

    Args:
        chunks: which experiments belong together.
        prepared: gives those of a chunk with their lanes.
        device: see DEVICES.
        empty: makes the arrays that results are written into.
    """
    require_device(device)
    from maglev_env.kernel.gpu import gathered_on_gpu

    together = max(1, ON_GPU // (chunks[0].stop - chunks[0].start))
    for start in range(0, len(chunks), together):
        own = [(chunk, prepared(chunk)) for chunk in chunks[start : start + together]]
        blocks = [block for _, parts in own for part in parts for block in part.blocks]
        of_block = {id(done.block): done for done in gathered_on_gpu(blocks, empty=empty)}
        yield [
            (chunk, [replace(part, gathered=[of_block[id(block)] for block in part.blocks]) for part in parts])
            for chunk, parts in own
        ]
