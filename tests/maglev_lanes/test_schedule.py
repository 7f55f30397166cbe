"""Work on many machines: the same bits wherever it is done, and nothing lost but time when a worker dies."""

import builtins
import json
import os
import signal
import socket
import stat
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from short_sweeps import short_rig, short_sweep
from typer.testing import CliRunner
from worker_jobs import deadly, said, slow_square, square

from maglev_env.rig.rig_file import load_rig
from maglev_env.task.task import make_task
from maglev_lanes import schedule
from maglev_lanes.schedule import workers
from maglev_workbench.cli import app
from sim2real.blind.answer import answer_all
from tuning import sweep_run as sweep_module
from tuning.comparison.compare import compare
from tuning.learned.training import Plan, train
from tuning.learned.worlds import World
from tuning.search.space_filling import Sobol
from tuning.study.study import JOURNAL, run_study
from tuning.sweep_run import run_sweep

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")


@pytest.fixture(scope="module")
def local():
    """Two processes of this machine, started again when they die; work that ends one is given up at once."""
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), workers("local:2") as pool:
        yield pool


@pytest.fixture(scope="module")
def address(local):
    """The scheduler of the two processes, as one finds it that did not start them, but whose settings hold its key."""
    keys = {
        "distributed.comm.tls.ca-file": local._client.security.tls_ca_file,
        "distributed.comm.tls.client.cert": local._client.security.tls_client_cert,
        "distributed.comm.tls.client.key": local._client.security.tls_client_key,
    }
    with dask.config.set(keys):
        yield local._client.scheduler.address


@pytest.fixture
def plan():
    return short_sweep(short_rig())


def pids(address):
    """Of both processes, which may only now be coming back."""
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, 60)
        return sorted(client.run(os.getpid).values())


def same_chunks(one, other):
    """Both folders hold the same chunks, bit for bit."""
    names = sorted(path.name for path in (one / "chunks").iterdir())
    assert names == sorted(path.name for path in (other / "chunks").iterdir())
    for name in names:
        with np.load(one / "chunks" / name) as a, np.load(other / "chunks" / name) as b:
            assert a.files == b.files and all(a[key].tobytes() == b[key].tobytes() for key in a.files)


@pytest.mark.slow
def test_results_come_with_their_places_and_items_are_taken_as_they_are_needed(address):
    taken = []

    def items():
        for i in range(30):
            taken.append(i)
            yield i

    with workers(address) as pool:
        assert len(pool) == 2 and pool.map(square, range(9)) == [x * x for x in range(9)]
        results = pool.each(slow_square, items())
        i, first = next(results)
        assert first == i * i and len(taken) <= 5
        results.close()  # as Ctrl-C does: the rest is dropped
        assert len(taken) <= 5 and pool.map(square, [3]) == [9]
        with pytest.raises(ArithmeticError, match="-1 is below 0"):
            pool.map(square, [1, -1, 2])


@pytest.mark.slow
def test_what_ends_every_worker_is_told_from_what_ran_beside_it(address):
    with workers(address) as pool, pytest.raises(OSError, match="part 3 of the work ended every worker"):
        pool.map(deadly, range(5))


@pytest.mark.slow
def test_a_sweep_is_the_same_on_workers_even_when_one_is_killed(address, plan, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_module, "CHUNK", 2)
    whole = run_sweep(plan, tmp_path / "here", threads=1)
    before, done = pids(address), []

    def kill_one(count, reused):
        done.append(count)
        if len(done) == 1:
            os.kill(before[0], signal.SIGKILL)

    with workers(address) as pool:
        assert run_sweep(plan, tmp_path / "there", progress=kill_one, workers=pool).identical(whole)
    assert sum(done) == 20 and before[0] not in pids(address)
    same_chunks(tmp_path / "here", tmp_path / "there")


@pytest.mark.slow
def test_a_sweep_stopped_on_workers_keeps_its_chunks_and_goes_on_anywhere(address, plan, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_module, "CHUNK", 2)
    seen = []

    def stop(count, reused):
        seen.append(count)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with workers(address) as pool, pytest.raises(KeyboardInterrupt):
        run_sweep(plan, tmp_path / "cut", progress=stop, workers=pool)
    assert len(list((tmp_path / "cut" / "chunks").iterdir())) == 3
    reused = []
    resumed = run_sweep(plan, tmp_path / "cut", progress=lambda n, old: reused.append(n if old else 0))
    assert sum(reused) == 6 and resumed.identical(run_sweep(plan, tmp_path / "whole"))


@pytest.mark.slow
def test_a_study_is_the_same_on_workers(local, tmp_path):
    task = make_task(protocol="quick")
    episode = task.draw(np.random.default_rng(0))

    def study(name, pool):
        run_study(tmp_path / name, task, episode, Sobol(3, 5), {"method": "sobol"}, 12, 7, workers=pool)
        return (tmp_path / name / JOURNAL).read_bytes()

    assert study("there", local) == study("here", None)


@pytest.mark.slow
def test_a_comparison_is_the_same_on_workers(local, tmp_path, monkeypatch):
    for name, value in (("compare.SEARCH", 30), ("compare.CHUNK", 2), ("runs.CHUNK", 2)):
        monkeypatch.setattr(f"tuning.comparison.{name}", value)
    task = make_task(protocol="quick", randomization="wide")
    told = []

    def found(name, pool):
        return compare(
            task, ("sobol", "tpe"), 3, (2,), 1, 1, tmp_path / name, lambda *said: told.append(said), workers=pool
        )

    there, here = found("there", local), found("here", None)
    np.testing.assert_array_equal(there.best, here.best)
    for method, result in there.results.items():
        np.testing.assert_array_equal(result.score, here.results[method].score)
    assert sum(n for said, n in told if said == "best of each rig") == 2 * 3 * 30


@pytest.mark.slow
def test_training_is_the_same_on_workers(local):
    world = World(load_rig("hmb_free"), budget=3)
    plan = Plan(rigs=4, rounds=2, search=12, epochs=3, history=3, width=16)
    there, here = train(world.draw, plan, 1, workers=local), train(world.draw, plan, 1)
    seen = np.random.default_rng(0).uniform(-1, 1, (5, 2, len(here[0].shape.names)))
    np.testing.assert_array_equal(there[0].act(seen), here[0].act(seen))
    assert there[1] == here[1]


@pytest.mark.slow
def test_campaigns_are_sent_to_workers_that_do_not_see_the_folder(address, tmp_path):
    for i in range(4):
        campaign = tmp_path / "campaigns" / f"c{i:04d}"
        campaign.mkdir(parents=True)
        (campaign / "campaign.toml").write_text("a = 1\n")
        (campaign / "base.npz").write_bytes(bytes(2999) + bytes([7]))
    (tmp_path / "labels.sha256").write_text("0 labels.json")
    with workers(address) as pool:
        found = answer_all(tmp_path, diagnose=said, workers=pool)
    assert (found.new, found.failed) == (4, 1)
    answers = [json.loads((tmp_path / "answers" / f"c{i:04d}.json").read_text()) for i in range(4)]
    assert answers[1]["error"] == "its process died" and answers[1]["seconds"] > 0
    assert all(answers[i]["diagnosis"]["cause"] == ["delay"] for i in (0, 2, 3))


@pytest.mark.slow
def test_workers_of_another_version_are_refused(address, tmp_path, monkeypatch):
    with workers(address) as pool:
        pool._code = "0.1.0+other"  # as a worker of other code finds it that joins later
        with pytest.raises(ValueError, match=r"runs maglev-workbench .*, this machine 0\.1\.0\+other"):
            pool.map(square, [1])
    (tmp_path / "maglev_workbench-0.0.7.dist-info").mkdir()
    (tmp_path / "maglev_workbench-0.0.7.dist-info" / "METADATA").write_text("Name: maglev-workbench\nVersion: 0.0.7\n")
    monkeypatch.syspath_prepend(tmp_path)  # of this process, not of the workers
    with pytest.raises(ValueError, match=r"runs maglev-workbench 0\.1\.0, this machine 0\.0\.7"), workers(address):
        pass


@pytest.mark.slow
def test_schedulers_without_fitting_workers_are_refused(monkeypatch):
    monkeypatch.setattr(schedule, "TIMEOUT", 0.5)
    bare = {"processes": False, "host": "127.0.0.1", "dashboard_address": ":0", "memory_limit": 0, "protocol": "tcp"}
    for more, words in (({"n_workers": 0}, "no workers"), ({"n_workers": 1, "threads_per_worker": 2}, "has 2 threads")):
        with ExitStack() as stack:
            cluster = stack.enter_context(distributed.LocalCluster(**bare, **more))
            stack.enter_context(pytest.raises((OSError, ValueError), match=words))
            stack.enter_context(workers(cluster.scheduler_address))


def test_an_address_where_no_scheduler_answers_is_refused_in_words(monkeypatch):
    monkeypatch.setattr(schedule, "TIMEOUT", 0.3)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        closed = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(OSError, match=f"no Dask scheduler answers at {closed} .*refused"), workers(closed):
            pass
        other.listen()
        with pytest.raises(OSError, match=r"no Dask scheduler answers .*silent for 0\.3 s"), workers(closed):
            pass
    with workers(None) as nothing:
        assert nothing is None


@pytest.mark.parametrize("address", ["host:8786", "tcp://host", "local:0", "local", "tcp://:8786", "http://host:80"])
def test_what_is_no_address_is_refused_by_every_command(address, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set.json").write_text("{}")
    for command in (["sweep"], ["tune"], ["blind", "answer", str(tmp_path)]):
        result = CliRunner().invoke(app, [*command, "--scheduler", address])
        assert result.exit_code == 2 and "give tcp://host:8786" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["set.json"]


def test_threads_beside_a_scheduler_and_a_missing_extra_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["sweep", "--scheduler", "local:2", "--threads", "2"])
    assert result.exit_code == 2 and "either --scheduler or" in result.output
    real = builtins.__import__

    def without(name, *rest):
        if name.split(".")[0] in ("dask", "distributed"):
            raise ImportError(name)
        return real(name, *rest)

    for name in [n for n in sys.modules if n.split(".")[0] in ("dask", "distributed")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(builtins, "__import__", without)
    result = CliRunner().invoke(app, ["sweep", "--scheduler", "local:2"])
    assert result.exit_code == 2 and 'pip install "dask[distributed]"' in result.output


@pytest.mark.slow
def test_the_command_sweeps_on_a_scheduler(address, tmp_path):
    grid = ["sweep", "--kp", "7000:9000:2", "--kd", "5:6:2"]
    for more in (["--out", str(tmp_path / "here")], ["--out", str(tmp_path / "there"), "--scheduler", address]):
        result = CliRunner().invoke(app, [*grid, *more])
        assert result.exit_code == 0, result.output + str(result.exception)
    same_chunks(tmp_path / "here", tmp_path / "there")


@pytest.mark.slow
def test_nobody_else_can_use_the_processes_of_this_machine(local):
    """tests/tools/daskopen.py attacks from outside; with --unprotected it shows that its attacks do succeed."""
    tool = Path(__file__).parents[1] / "tools" / "daskopen.py"
    tried = subprocess.run([sys.executable, tool], capture_output=True, text=True, timeout=120)
    assert tried.returncode == 0 and "0 of 49 succeeded" in tried.stdout, tried.stdout + tried.stderr
    folders = local._client.run(lambda dask_worker: dask_worker.local_directory).values()
    modes = {stat.S_IMODE(Path(folder).parents[1].stat().st_mode) for folder in folders}
    assert modes == {0o700}
