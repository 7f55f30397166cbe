"""Check and time the lanes of a GPU against those of the processor, on a machine that has one.

Usage: python tests/tools/gpu_check.py [--out FOLDER] [--only STAGE ...] [--tiny]

The extra `cuda` must be installed (see `maglev_lanes.gpu`). Stages: about, compile, agree, agree-xy, kernel, kernel-xy,
quick, full, judge, processes, apart, sweep. Each prints its figures as they come and, with --out, writes them into
gpu_check.json there; one that fails prints why, and the next begins. --tiny: a few short experiments, as numba's
simulator can run them (NUMBA_ENABLE_CUDASIM=1).

`--only about apart sweep` asks what judging in processes gains, in about three minutes; with --out its table also
stands in judging.md.
"""

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from traceback import print_exc
from typing import Any

import numpy as np

from maglev_env.evaluation.devices import Prepared, require_device, simulated_groups
from maglev_env.evaluation.evaluate import CHUNK, evaluate
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.evaluation.judging import evaluated, ready
from maglev_env.evaluation.score import stacked
from maglev_env.evaluation.target import score_target
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.blocks import own_lanes
from maglev_env.kernel.gpu import Lanes, gathered_on_gpu
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.loop.gains import with_gains
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.protocol import env_protocol
from maglev_lanes.layout import LANES
from maglev_lanes.processes import fresh_pool
from maglev_lanes.shared_pool import shared_pool
from maglev_lanes.threads import over_threads
from tuning.axis import Axis
from tuning.sweep import Sweep
from tuning.sweep_run import run_sweep

WORKERS = (1, 2, 4, 8, 16)
SECONDS = 3.0  # of a figure of the processor
KERNEL_LANES = (1024, 4096, 16384, 65536)
PIPELINE = {"quick": (1024, 8192, 65536), "full": (1024, 8192, 32768)}
COMPARED = ("stiffness", "damping", "score", "peak_sensitivity", "phase_margin", "current_rms", "peak_displacement")


class Check:
    """The stages, and the figures found up to now."""

    def __init__(self, out: Path | None, tiny: bool) -> None:
        self.out, self.tiny = out, tiny
        self.found: dict[str, Any] = {}

    def say(self, stage: str, **figures: Any) -> None:
        """Print figures and keep them."""
        self.found.setdefault(stage, []).append(figures)
        told = ", ".join(
            f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in figures.items()
        )
        print(f"[{perf_counter() - BEGUN:6.1f} s] {stage}: {told}", flush=True)
        if self.out:
            (self.out / "gpu_check.json").write_text(json.dumps(self.found, indent=1))

    def experiments(self, rig: str, count: int, protocol: str = "full", **changes: Any) -> list[Experiment]:
        """Gain sets around the preset, each with its own noise."""
        loaded = load_rig(rig)
        loaded = replace(loaded, protocol=env_protocol(loaded, protocol), **changes)
        shares = np.random.default_rng(7).uniform(0.8, 1.25, (count, 2))
        first = protocol_experiment(loaded)
        if self.tiny:
            lines = ((1, 3, 4, 6, 7, 8), (2, 5, 9, 11))
            parts = zip(first.excitations, lines, strict=False)
            excitations = tuple(replace(e, fundamental=200.0, lines=own) for e, own in parts)
            target = replace(loaded.target, band=(200.0, 1700.0))
            first = replace(
                first, rig=replace(loaded, target=target), excitations=excitations, periods=3, transient_periods=1
            )
        found = []
        for i, (p, d) in enumerate(shares):
            own = loaded.gains[0] if isinstance(loaded.gains, tuple) else loaded.gains
            gains = with_gains(loaded.gains, kp=float(p * own.kp), kd=float(d * own.kd))
            found.append(replace(first, gains=gains, seed=(0, i)))
        return found

    def scored(self, experiments: list[Experiment], **how: Any) -> Evaluation:
        """Evaluated; tiny ones have few lines, and so one band."""
        return evaluate(experiments, bands=np.array([[200.0, 1700.0]]) if self.tiny else None, **how)

    def about(self) -> None:
        names = ("numba", "llvmlite", "numba-cuda", "cuda-bindings", "cuda-core", "numpy", "scipy", "xarray")
        self.say(
            "about", device=require_device("cuda"), python=platform.python_version(), cores=os.cpu_count() or 0,
            load=os.getloadavg()[0], **{name: _version(name) for name in names},
        )  # fmt: skip

    def compile(self) -> None:
        for rig in ("hmb_free", "hmb_radial"):
            begun = perf_counter()
            lanes = Lanes(own_lanes(self.experiments(rig, 4, "quick")))
            seconds = [perf_counter() - begun]
            for work in (partial(lanes.advance, 0, True), lanes.transform, partial(lanes.add, 0, 1)):
                begun = perf_counter()
                work()
                lanes.synchronise()
                seconds.append(perf_counter() - begun)
            names = ("prepared", "step", "transform", "statistics")
            self.say("compile", rig=rig, **{f"{n}_s": s for n, s in zip(names, seconds, strict=True)})

    def agree(self, rig: str, stage: str) -> None:
        count = 4 if self.tiny else 256
        for name, changes in (("ideal converters", {"adc_bits": 0, "dac_bits": 0}), ("converters", {})):
            experiments = self.experiments(rig, count, "full", **changes)
            blocks = own_lanes(experiments)
            on_gpu = list(gathered_on_gpu(blocks))
            again = list(gathered_on_gpu(blocks, most=3))
            same = all(
                np.array_equal(a.statistics.mean(), b.statistics.mean())
                and np.array_equal(a.statistics.covariance(), b.statistics.covariance())
                and np.array_equal(a.state.rows, b.state.rows)
                for a, b in zip(on_gpu, again, strict=True)
            )
            gpu = simulate_statistics(experiments, blocks=blocks, gathered=on_gpu)
            cpu = simulate_statistics(experiments, blocks=blocks)
            size = np.abs(cpu.statistics.mean).max(axis=(0, 2))
            off = np.nanmax(np.abs(gpu.statistics.mean - cpu.statistics.mean), axis=(0, 2)) / np.where(
                size > 0, size, 1.0
            )
            self.say(
                stage, case=name, same_bits_in_parts=bool(same), lost=int((~np.isfinite(gpu.peak_displacement)).sum()),
                **{f"amplitudes_{c}": float(o) for c, o in zip(cpu.statistics.channels, off, strict=True)},
            )  # fmt: skip
            if self.tiny:
                continue
            one, two = evaluate(experiments), evaluate(experiments, device="cuda")
            for quantity in COMPARED:
                a, b = (getattr(e, quantity, None) if hasattr(e, quantity) else e.margins[quantity] for e in (one, two))
                keep = np.isfinite(a) & np.isfinite(b)
                relative = np.abs(b[keep] - a[keep]) / np.maximum(np.abs(a[keep]), 1e-12)
                self.say(stage, case=name, quantity=quantity, compared=int(keep.sum()), relative=float(relative.max()))
            for quantity in ("stiffness", "damping"):
                width = getattr(one, f"{quantity}_high") - getattr(one, f"{quantity}_low")
                moved = np.abs(getattr(two, quantity) - getattr(one, quantity)) / (width / 3.92)
                self.say(stage, case=name, quantity=quantity, of_standard_error=float(np.nanmax(moved)))

    def kernel(self, rig: str, stage: str) -> None:
        """Times of the parts of a period, by number of lanes."""
        for count in (32,) if self.tiny else KERNEL_LANES:
            few = own_lanes(self.experiments(rig, LANES, "quick"))
            try:
                lanes = Lanes([few[0]] * (count // LANES))
            except Exception as error:
                self.say(stage, lanes=count, failed=" ".join(str(error).split())[:200])
                return
            axes, samples = lanes.axes, lanes.experiment.samples_per_period
            lanes.advance(0, True)
            lanes.transform()
            lanes.add(0, 1)
            lanes.synchronise()
            times = {}
            for name, work in (
                ("step", partial(lanes.advance, 1, False)),
                ("transform", lanes.transform),
                ("statistics", partial(lanes.add, 1, 2)),
            ):
                times[name] = _shortest(work, lanes.synchronise, 1 if self.tiny else 5)
            begun = perf_counter()
            for _ in lanes.fetched(2):
                pass
            fetched = perf_counter() - begun
            per = count * samples
            self.say(
                stage, lanes=count, axes=axes, samples=samples, step_ms=times["step"] * 1e3,
                step_ns=times["step"] / per * 1e9, transform_ns=times["transform"] / per * 1e9,
                statistics_ns=times["statistics"] / per * 1e9, fetch_us_per_lane=fetched / count * 1e6,
            )  # fmt: skip
            del lanes

    def pipeline(self, protocol: str) -> None:
        """Gain sets per second, of the processor by workers and of the GPU by number of gain sets."""
        cores = os.cpu_count() or 1
        one = self.experiments("hmb_free", 64 if not self.tiny else 2, protocol)
        if not self.tiny:
            self.scored(one, threads=1)
        begun = perf_counter()
        self.scored(one, threads=1)
        each = (perf_counter() - begun) / len(one)
        self.say(protocol, ms_of_one_core=each * 1e3)
        for workers in (1,) if self.tiny else [w for w in WORKERS if w <= cores]:
            chunks = int(np.ceil(SECONDS / each * min(workers, 4) / CHUNK / workers))
            count = len(one) if self.tiny else chunks * CHUNK * workers
            experiments = self.experiments("hmb_free", count, protocol)
            begun = perf_counter()
            self.scored(experiments, threads=workers)
            self.say(protocol, device="cpu", threads=workers, sets=count, per_second=count / (perf_counter() - begun))
        warm = one[:2] if self.tiny else one
        self.scored(warm, device="cuda")
        for count in (2,) if self.tiny else PIPELINE[protocol]:
            experiments = self.experiments("hmb_free", count, protocol)
            begun = perf_counter()
            self.scored(experiments, device="cuda")
            self.say(protocol, device="cuda", sets=count, per_second=count / (perf_counter() - begun))
            prepared, simulated = _simulated_alone(experiments)
            self.say(
                protocol, device="cuda", sets=count, prepare_us=prepared / count * 1e6,
                simulated_per_second=count / simulated,
            )  # fmt: skip

    def judge(self) -> None:
        """Gain sets per second of what follows the simulation, by threads and gain sets judged together."""
        count = 2 if self.tiny else 8192
        experiments = self.experiments("hmb_free", count, "full")
        target = score_target(experiments[0].rig)
        bands = np.array([[200.0, 1700.0]]) if self.tiny else None
        for together in (64, CHUNK, 256):
            chunks = [slice(start, start + together) for start in range(0, count, together)]

            def prepared(chunk: slice) -> list[Prepared]:
                return [Prepared(experiments[chunk], own_lanes(experiments[chunk]))]

            parts = [made[0] for group in simulated_groups(chunks, prepared, "cuda") for _, made in group]

            def work(part: Prepared) -> object:
                return evaluated(part, [stacked([target] * len(part.experiments))], bands, None)

            for threads in (1,) if self.tiny else [w for w in WORKERS if w <= (os.cpu_count() or 1)]:
                some = parts[: max(threads, len(parts) // 4)] if threads < 4 else parts
                begun = perf_counter()
                for _ in over_threads(work, some, threads):
                    pass
                seconds = perf_counter() - begun
                done = sum(len(part.experiments) for part in some)
                self.say("judge", together=together, threads=threads, per_second=done / seconds)

    def processes(self) -> None:
        """Gain sets per second of the full protocol in as many processes of one thread each."""
        for workers in self.workers(WORKERS):
            each = 2 if self.tiny else 1024
            self.say("processes", workers=workers, **self.alone("full", workers, each))

    def workers(self, numbers: Sequence[int]) -> Sequence[int]:
        """Those that this machine has cores for."""
        return (1,) if self.tiny else [w for w in numbers if w <= (os.cpu_count() or 1)]

    def alone(self, protocol: str, workers: int, each: int) -> dict[str, float]:
        """Gain sets per second in processes of one thread each, without a GPU; each makes its own experiments."""
        with fresh_pool(workers) as pool:
            list(pool.map(_scored_there, [(self.tiny, 2, protocol)] * workers))  # starts all
            begun = perf_counter()
            list(pool.map(_scored_there, [(self.tiny, each, protocol)] * workers))
            return {"sets": workers * each, "per_second": workers * each / (perf_counter() - begun)}

    def apart(self) -> None:
        """Gain sets per second to the score on the GPU: judged on threads and in processes, and beside a CPU's."""
        rows = []
        for protocol, count in (("full", 16384), ("quick", 32768)):
            experiments = self.experiments("hmb_free", 4 if self.tiny else count, protocol)
            some = experiments[: 4 if self.tiny else 4096]
            self.scored(some, device="cuda")
            begun = perf_counter()
            expected = self.scored(experiments, device="cuda")
            threads = len(experiments) / (perf_counter() - begun)
            self.say("apart", protocol=protocol, judged_on="threads", sets=len(experiments), per_second=threads)
            rows.append((protocol, "GPU, judged on threads", threads))
            for processes in self.workers((1, 4, 8, 16)):
                begun = perf_counter()
                with shared_pool(processes, ready) as judges:
                    self.scored(some, device="cuda", judges=judges)
                    started = perf_counter() - begun
                    begun = perf_counter()
                    found = self.scored(experiments, device="cuda", judges=judges)
                    seconds = perf_counter() - begun
                figures = {"sets": len(experiments), "per_second": len(experiments) / seconds, "started_s": started}
                same = all(
                    np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=True)
                    for name in ("stiffness", "damping_high", "band_stiffness", "score", "pole_radius")
                )
                self.say("apart", protocol=protocol, judged_in=processes, same_bits=same, **figures)
                rows.append((protocol, f"GPU, judged in {processes} processes", figures["per_second"]))
            prepared, seconds = _simulated_alone(experiments)
            simulated = len(experiments) / seconds
            self.say(
                "apart", protocol=protocol, simulated_per_second=simulated, lanes_us=prepared / len(experiments) * 1e6
            )
            rows.append((protocol, "GPU, simulated alone, lanes made before", simulated))
            for workers in self.workers((1, 16)):
                figures = self.alone(protocol, workers, 2 if self.tiny else {"full": 768, "quick": 2048}[protocol])
                self.say("apart", protocol=protocol, processes=workers, **figures)
                rows.append((protocol, f"no GPU, {workers} processes", figures["per_second"]))
        if self.out:
            lines = ["| protocol | how | gain sets per second |", "|---|---|---|"]
            lines += [f"| {protocol} | {how} | {value:.0f} |" for protocol, how, value in rows]
            (self.out / "judging.md").write_text("\n".join(lines) + "\n")

    def sweep(self) -> None:
        """Gain sets per second of whole sweeps to their files, as the command makes them."""
        rig = load_rig("hmb_free")
        points = 2 if self.tiny else 128
        for device in ("cuda",) if self.tiny else ("cuda", "cpu"):
            if self.tiny:
                short = self.experiments("hmb_free", 1)[0]
                protocol = replace(rig.protocol, excitations=short.excitations, periods=3, transient_periods=1)
                rig = replace(short.rig, protocol=replace(protocol, band_width=1300.0, band_overlap=0.0))
            axes = {"kp": Axis(4000.0, 16000.0, points), "kd": Axis(2.0, 12.0, points)}
            with TemporaryDirectory() as folder:
                begun = perf_counter()
                run_sweep(Sweep(rig, axes, device=device), Path(folder) / "sweep", processes=True)
                seconds = perf_counter() - begun
            self.say("sweep", device=device, sets=points**2, seconds=seconds, per_second=points**2 / seconds)


def _scored_there(work: tuple[bool, int, str]) -> int:
    """Score as many gain sets of a protocol in this process; what is returned is of no use."""
    tiny, count, protocol = work
    check = Check(None, tiny)
    return len(check.scored(check.experiments("hmb_free", count, protocol), threads=1).score)


def _simulated_alone(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Seconds that making the lanes of experiments takes, and simulating them on the GPU."""
    begun = perf_counter()
    blocks = own_lanes(experiments)
    made = perf_counter()
    for _ in gathered_on_gpu(blocks):
        pass
    return made - begun, perf_counter() - made


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def _shortest(work: Callable[[], None], wait: Callable[[], None], rounds: int) -> float:
    found = []
    for _ in range(rounds):
        begun = perf_counter()
        work()
        wait()
        found.append(perf_counter() - begun)
    return min(found)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder of gpu_check.json and judging.md")
    parser.add_argument("--only", nargs="+", help="stages")
    parser.add_argument("--tiny", action="store_true", help="few short experiments")
    asked = parser.parse_args(arguments)
    check = Check(asked.out, asked.tiny)
    stages: dict[str, Callable[[], None]] = {
        "about": check.about,
        "compile": check.compile,
        "agree": lambda: check.agree("hmb_free", "agree"),
        "agree-xy": lambda: check.agree("hmb_radial", "agree-xy"),
        "kernel": lambda: check.kernel("hmb_free", "kernel"),
        "kernel-xy": lambda: check.kernel("hmb_radial", "kernel-xy"),
        "quick": lambda: check.pipeline("quick"),
        "full": lambda: check.pipeline("full"),
        "judge": check.judge,
        "processes": check.processes,
        "apart": check.apart,
        "sweep": check.sweep,
    }
    failed = []
    for name in asked.only or stages:
        try:
            stages[name]()
        except Exception:
            print(f"stage {name} failed:", flush=True)
            print_exc(file=sys.stdout)
            failed.append(name)
    print(f"failed: {', '.join(failed) or 'nothing'}", flush=True)
    return 1 if failed else 0


BEGUN = perf_counter()

if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
