"""Lanes of a GPU, in numba's simulator, against those of the processor; and what is refused before any work."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gpu_in_simulator
import numpy as np
import pytest
from gpu_in_simulator import CASES, COUNT, JUDGED, LOST, experiments, figures, judged

from maglev_env.evaluation.devices import require_device
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel import gpu
from maglev_env.kernel.advance import kernel
from maglev_env.kernel.blocks import own_lanes
from maglev_env.kernel.state import State
from maglev_env.kernel.touched import touched_rows
from maglev_env.loop.effect import parse_effects
from maglev_env.rig.rig_file import load_rig
from maglev_lanes import gpu as lanes_gpu

SCRIPT = Path(gpu_in_simulator.__file__)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Results of all cases in the simulator."""
    to = tmp_path_factory.mktemp("gpu") / "results.npz"
    subprocess.run([sys.executable, SCRIPT, to], check=True, env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"})
    with np.load(to) as found:
        return dict(found)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_gpu_gives_what_the_processor_gives(case: str, simulated: dict[str, np.ndarray]) -> None:
    own = experiments(case)
    for name, values in figures(own, own_lanes(own)).items():
        largest = np.nan_to_num(np.abs(values)).max()
        np.testing.assert_allclose(simulated[f"{case}/{name}"], values, rtol=1e-9, atol=1e-12 * largest, err_msg=name)


@pytest.mark.slow
def test_lanes_have_the_same_bits_however_many_are_together(simulated: dict[str, np.ndarray]) -> None:
    assert len(simulated["one axis/mean"]) == COUNT
    assert np.isnan(simulated["one axis/mean"][LOST]).all() and np.isfinite(simulated["one axis/touchdown_time"][LOST])
    for name in ("mean", "covariance", "touchdown_time", "peak_displacement", "current_rms"):
        np.testing.assert_array_equal(simulated[f"one axis/{name}"], simulated[f"one axis in parts/{name}"])


@pytest.mark.slow
def test_what_a_gpu_simulated_is_judged_alike(simulated: dict[str, np.ndarray]) -> None:
    expected = judged(experiments("one axis")[:JUDGED], "cpu")
    assert expected["feasible"].sum() == JUDGED - 1
    for name, values in expected.items():
        np.testing.assert_allclose(simulated[f"judged/{name}"], values, rtol=1e-8, err_msg=name)


@pytest.mark.slow
def test_processes_judge_with_the_same_bits(simulated: dict[str, np.ndarray]) -> None:
    here = {key.removeprefix("judged/"): values for key, values in simulated.items() if key.startswith("judged/")}
    assert len(here) > 10 and simulated["memories"] == 3  # means, second moments, states; the second time the same ones
    for name, values in here.items():
        for turn in ("apart", "again"):
            np.testing.assert_array_equal(simulated[f"{turn}/{name}"], values, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_no_row_that_the_kernel_changes_is_missed(case: str) -> None:
    block = own_lanes(experiments(case))[0]
    used, written = touched_rows(block.batch.structure)
    state, structure = State(block), block.batch.structure
    before, n = state.rows.copy(), 64
    rng = np.random.default_rng(0)
    waves = [rng.normal(0, size, n * structure.axes) for size in (0.3, 0.1, 1e-6)]
    kernel(structure)(
        state.rows.reshape(-1), np.ascontiguousarray(state.seeds[:, 0]).reshape(-1), state.history, 0, state.timing,
        structure.switches(), np.empty(0, np.int64), *waves, np.empty(n * structure.axes * 3 * 16),
    )  # fmt: skip
    changed = np.flatnonzero((state.rows != before).any(axis=1))
    assert set(changed) <= set(written) <= set(used)
    # Rows that are not used may hold anything.
    other, spoilt = State(block), np.setdiff1d(np.arange(len(before)), used)
    other.rows[spoilt] = np.nan
    kernel(structure)(
        other.rows.reshape(-1), np.ascontiguousarray(other.seeds[:, 0]).reshape(-1), other.history, 0, other.timing,
        structure.switches(), np.empty(0, np.int64), *waves, np.empty(n * structure.axes * 3 * 16),
    )  # fmt: skip
    np.testing.assert_array_equal(other.rows[used], state.rows[used])


def test_a_machine_without_a_gpu_is_told_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"pip install .*maglev-workbench\[cuda\]"):
        require_device("cuda")
    with pytest.raises(ValueError, match=r"pip install .*maglev-workbench\[cuda\]"):
        evaluate([protocol_experiment(load_rig("hmb_free"))], device="cuda")
    with pytest.raises(ValueError, match="--device gpu: use one of cpu, cuda"):
        require_device("gpu")


def test_what_a_gpu_does_not_simulate_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu, "require_gpu", lambda: "a GPU")
    with pytest.raises(ValueError, match="self-sensing is not simulated on a GPU"):
        require_device("cuda", "self_sensing")
    sensed = own_lanes([protocol_experiment(load_rig("hmb_free"), sensor="self_sensing")])
    with pytest.raises(ValueError, match="self-sensing is not simulated on a GPU"):
        list(gpu.gathered_on_gpu(sensed))
    several = [replace(block, substeps=2) for block in own_lanes([protocol_experiment(load_rig("hmb_free"))])]
    with pytest.raises(ValueError, match="substeps"):
        list(gpu.gathered_on_gpu(several))


def test_a_numpy_that_does_not_fit_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(name: str) -> None:
        raise AttributeError("module 'numpy' has no attribute 'row_stack'")

    monkeypatch.setattr(lanes_gpu, "import_module", gone)
    monkeypatch.setattr(lanes_gpu, "version", lambda name: "0.30.4")
    with pytest.raises(ValueError, match=rf"numba-cuda 0.30.4 does not work with numpy {np.__version__} .*row_stack"):
        lanes_gpu._require_fitting_numpy()


def test_too_little_memory_is_told_with_what_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu, "require_gpu", lambda: "a GPU")
    monkeypatch.setattr(gpu, "free_memory", lambda: 5_000_000)
    blocks = own_lanes([protocol_experiment(load_rig("hmb_free"))])
    with pytest.raises(ValueError, match=r"5 MB are free on the GPU; a block of 16 lanes takes \d+ MB"):
        list(gpu.gathered_on_gpu(blocks))


def test_delays_of_several_samples_are_kept() -> None:
    late = protocol_experiment(load_rig("hmb_free"), None, parse_effects(["delay=2e-4"]))
    assert own_lanes([late])[0].batch.history_length > 2  # so that the case "delay" reads the longer history
