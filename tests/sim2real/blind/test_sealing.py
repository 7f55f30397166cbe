"""Making a sealed set goes on where it was interrupted."""

import json
from hashlib import sha256
from pathlib import Path

import pytest

from sim2real.blind.sealing import sealed, unfinished

CALLS: list[int] = []


def produce(case: int, folder: Path, seed: int) -> dict:
    CALLS.append(case)
    if (folder / "stop").exists() and case == 2:
        raise KeyboardInterrupt
    return {"id": case, "value": 0.1 * case + seed}


def test_an_interrupted_set_goes_on_and_has_the_same_seal(tmp_path):
    CALLS.clear()
    labels, steps = tmp_path / "labels.json", []
    (tmp_path / "stop").touch()
    with pytest.raises(KeyboardInterrupt):
        sealed(produce, [1, 2, 3], 1, labels, lambda: steps.append(1), folder=tmp_path, seed=4)
    assert CALLS == [1, 2] and len(steps) == 1 and not labels.exists()
    with pytest.raises(ValueError, match="another seed or count"):
        sealed(produce, [1, 2, 3], 1, labels, folder=tmp_path, seed=5)
    (tmp_path / "stop").unlink()
    CALLS.clear()
    seal = sealed(produce, [1, 2, 3], 1, labels, lambda: steps.append(1), folder=tmp_path, seed=4)
    assert CALLS == [2, 3] and len(steps) == 4
    assert not unfinished(labels).exists()
    whole = sealed(produce, [1, 2, 3], 1, tmp_path / "again.json", folder=tmp_path, seed=4)
    assert seal == whole == sha256(labels.read_bytes()).hexdigest()
    assert json.loads(labels.read_text())[2] == {"id": 3, "value": 0.1 * 3 + 4}


@pytest.mark.slow
def test_processes_make_the_same_labels(tmp_path):
    one = sealed(produce, [1, 2, 3], 1, tmp_path / "a.json", folder=tmp_path, seed=4)
    assert sealed(produce, [1, 2, 3], 2, tmp_path / "b.json", folder=tmp_path, seed=4) == one
