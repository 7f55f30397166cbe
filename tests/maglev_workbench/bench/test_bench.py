"""The benchmark: every figure is there and consistent, comparisons tell better from worse, bad files are refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.loop.gains import controller_response
from maglev_workbench.cli import app
from maglev_workbench.commands.bench import sections, timing
from maglev_workbench.commands.bench.figures import Figure, as_json, changes, differences, read_results, results_here
from maglev_workbench.commands.bench.kernels import VARIANTS, fifth_order, quiet_experiment, variants
from maglev_workbench.commands.bench.memory import block_figures, evaluation_peaks
from maglev_workbench.commands.bench.report import bench_page
from maglev_workbench.commands.bench.timing import Size, alternately
from maglev_workbench.console import write_json
from sim2real.search import attribute

TINY = Size(lanes=2, repeats=1, xy_lanes=1, record_seconds=2.0, memory_sets=(2, 4), compiled=0)
SIMULATORS = ("dlsim", "forced_response", "solve_ivp")
THREADED = ("", "_one_thread", "_two_threads")
NAMES = {
    "environments": {
        *(f"env_experiments_per_second_{n}" for n in (1, 8, 64, TINY.memory_sets[1])),
        "env_over_bare_evaluation",
        "env_control_samples_per_second",
    },
    "kernel": {
        "kernel_ns_per_step_and_lane",
        "kernel_with_noise_ns_per_step_and_lane",
        "one_lane_ns_per_step",
        "lanes_speedup",
        *(f"kernel_{v}_{end}" for v in VARIANTS for end in ("ns_per_step_and_lane", "over_one_axis")),
    },
    "compiling": {"cold_first_evaluation_seconds", "cold_kernels_compiled", "cold_kernel_seconds"},
    "other simulators": {
        "experiments_per_second_and_core",
        *(f"{s}_seconds" for s in SIMULATORS),
        *(f"times_faster_than_{s}" for s in SIMULATORS),
    },
    "kernel on threads": {
        *(f"kernel_steps_per_second{t}" for t in THREADED),
        "kernel_two_threads_over_one",
        "kernel_all_cores_over_one_thread",
    },
    "parts of an evaluation": {
        *(
            f"share_{part}_ms"
            for part in ("target", "lanes", "kernel", "fft", "statistics", "poles", "between_lines", "margins")
        ),
        "share_ml_points_all_bands_ms",
        "share_ml_intervals_target_band_ms",
        "share_least_squares_target_band_ms",
        "evaluation_ms",
        "evaluation_cores_used",
        "kernel_share_of_evaluation",
        "fft_share_of_evaluation",
        "parts_over_evaluation",
    },
    "gain sets per second": {
        *(f"{rig}gain_sets_per_second{t}" for rig in ("", "xy_") for t in THREADED),
        *(f"{rig}gain_sets_two_threads_over_one" for rig in ("", "xy_")),
        *(f"{rig}gain_sets_all_cores_over_one_thread" for rig in ("", "xy_")),
    },
    "estimators": {
        *(f"{name}_all_bands_ms" for name in ("least_squares", "ml_points", "ml_intervals", "row_sums")),
        *(
            f"{name}_all_bands_ms"
            for name in ("planar_least_squares", "eight_coefficients", "eight_coefficients_points")
        ),
        *(f"{name}_ms" for name in ("effective_coefficients", "modal_estimate", "margin_arrays", "distortion")),
        *(f"{name}_ms" for name in ("margins_with_intervals", "frequency_response", "local_polynomial_60_s")),
        "low_crest_250_lines_ms",
    },
    "self-sensing": {
        "self_sensing_ms_per_second_and_lane",
        "self_sensing_loop_ms_per_second_and_lane",
        "self_sensing_solve_ivp_ms_per_second",
        "self_sensing_times_faster_than_solve_ivp",
    },
    "rotor": {
        "rotor_kernel_ns_per_step_and_lane",
        "rotor_kernel_over_one_axis",
        "run_up_of_29_speeds_one_thread_seconds",
        "run_ups_per_second",
        "run_ups_together_over_one_thread",
    },
    "diagnoses": {
        *(f"diagnosis_{kind}_{what}" for kind in ("periodic", "open") for what in ("seconds", "over_kernel")),
    },
    "memory": {
        "peak_memory_2_gain_sets_mb",
        "peak_memory_4_gain_sets_mb",
        "peak_memory_4_over_2_gain_sets",
        "peak_rss_growth_2_to_4_gain_sets_mb",
        "block_state_bytes_per_lane",
        "block_output_bytes_per_lane",
    },
}


@pytest.fixture(scope="module")
def measured():
    """Figures of each section, measured when first asked for."""
    found = {}

    def of(section):
        if section not in found:
            with pytest.MonkeyPatch.context() as patch:  # a diagnosis among all effects takes too long for a test
                patch.setattr(attribute, "single_effects", lambda rig: ("delay",))
                found[section] = sections.SECTIONS[section](TINY)
        return found[section]

    return of


def sample(**changed):
    """Results that any page can be made of."""
    figures = {
        "experiments_per_second_and_core": Figure(500.0, "1/s", "higher"),
        "gain_sets_per_second": Figure(200.0, "1/s", "higher"),
        "dlsim_seconds": Figure(0.5, "s", None),
        "share_kernel_ms": Figure(1.0, "ms per gain set"),
        "margins_ms": Figure(0.1, "ms per gain set"),
        "growth_mb": Figure(0.0, "MB", None),
    }
    return results_here(figures | changed)


PEER = {"gym_electric_motor_control_samples_per_second", "env_times_gym_electric_motor"}


@pytest.mark.slow  # where no kernel is compiled yet
@pytest.mark.parametrize("section", sections.SECTIONS)
def test_every_figure_is_there_and_finite(section, measured):
    pytest.importorskip("control")
    figures = measured(section)
    # The last two are those of a peer that need not be installed.
    assert figures.keys() - PEER == NAMES[section]
    for name, figure in figures.items():
        assert math.isfinite(figure.value) and figure.unit and figure.better in ("lower", "higher", None), name
        assert figure.value > 0 or name.startswith("peak_rss_growth"), name


@pytest.mark.slow
def test_ratios_are_those_of_the_figures_beside_them(measured):
    kernel, simulators, parts = (measured(s) for s in ("kernel", "other simulators", "parts of an evaluation"))
    for name in VARIANTS:
        own = kernel[f"kernel_{name}_ns_per_step_and_lane"].value
        one = kernel["kernel_ns_per_step_and_lane"].value
        assert kernel[f"kernel_{name}_over_one_axis"].value == pytest.approx(own / one)
    factor = simulators["dlsim_seconds"].value * simulators["experiments_per_second_and_core"].value
    assert simulators["times_faster_than_dlsim"].value == pytest.approx(factor)
    total = sum(figure.value for name, figure in parts.items() if name.startswith("share_"))
    assert parts["parts_over_evaluation"].value == pytest.approx(total / parts["evaluation_ms"].value)


def test_a_blocks_output_is_three_channels_of_a_second_at_20_khz():
    assert block_figures()["block_output_bytes_per_lane"].value == 3 * 20000 * 8


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_gain_sets():
    (few, many), _ = evaluation_peaks((256, 768))
    assert many < 1.1 * few  # 512 more experiments and their results; a period of their lanes would be 40 MB


def test_variants_compile_what_they_are_named_after_and_fly():
    one = quiet_experiment()
    kinds = variants(one)
    assert tuple(kinds) == VARIANTS
    plain = structure_of(one)
    expected = {
        "xy": {"axes": 2},
        "xy_coupled": {"axes": 2, "coupled": True},
        "linear_controller": {"controller_order": 5},
        "electromagnet": {"magnets": "electromagnet"},
        "magnet_coil": {"magnets": "magnet_coil"},
        "amplifier_lag": {"actuator_poles": 2},
        "delay": {"delayed": True},
        "eddy_current": {
            "flexible": True,
            "supported": True,
            "sensor_poles": 2,
            "actuator_poles": 2,
            "delayed": True,
        },
    }
    for name, e in kinds.items():
        assert structure_of(e) == replace(plain, **expected[name])
        assert e.samples_per_period == one.samples_per_period


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_no_variant_touches_down(name):
    # A block whose lanes have all touched down steps no further, and its time would be nothing.
    assert np.isnan(simulate_statistics([variants(quiet_experiment())[name]]).touchdown_time).all()


def test_the_fifth_order_controller_is_the_pid():
    gains, dt = quiet_experiment().gains, 5e-5
    z = np.exp(2j * np.pi * np.geomspace(0.1, 9e3, 50) * dt)
    controller = fifth_order(gains, dt)
    assert controller.order == 5
    np.testing.assert_allclose(controller_response(controller, z, dt), controller_response(gains, z, dt), rtol=1e-9)


def timed_works(monkeypatch, seconds):
    """Works a and b that take these seconds, call after call, and the order of their calls."""
    order, clock, seconds = [], [0.0], iter(seconds)

    def work(name):
        def run():
            order.append(name)
            clock[0] += next(seconds)

        return run

    monkeypatch.setattr(timing, "perf_counter", lambda: clock[0])
    return {"a": work("a"), "b": work("b")}, order


def test_works_take_turns_and_the_best_counts(monkeypatch):
    works, order = timed_works(monkeypatch, [3.0, 1.0, 2.0, 1.5, 0.5, 7.0])
    assert alternately(works, 3) == {"a": 0.5, "b": 1.0}
    assert "".join(order) == "ababab"


def test_slow_works_are_repeated_once_only(monkeypatch):
    works, order = timed_works(monkeypatch, [30.0, 10.0, 20.0, 50.0, 1.0, 1.0])
    assert alternately(works, 3) == {"a": 20.0, "b": 10.0}
    assert "".join(order) == "abab"


def test_results_come_back_from_their_file(tmp_path):
    results = sample()
    write_json(tmp_path / "r.json", as_json(results))
    assert read_results(tmp_path / "r.json") == results
    assert results.processor and results.cores >= 1 and results.versions.keys() >= {"python", "numpy", "numba"}


def test_changes_are_worse_in_the_direction_that_each_figure_has():
    old = sample(
        time=Figure(10.0, "ms"),
        rate=Figure(10.0, "1/s", "higher"),
        share=Figure(0.1, "ratio", None),
        gone=Figure(1.0, "ms"),
        other_unit=Figure(1.0, "ms"),
        zero=Figure(0.0, "MB"),
    )

    def against(time, rate):
        new = sample(
            time=Figure(time, "ms"),
            rate=Figure(rate, "1/s", "higher"),
            share=Figure(0.9, "ratio", None),
            other_unit=Figure(1.0, "s"),
            zero=Figure(3.0, "MB"),
            fresh=Figure(1.0, "ms"),
        )
        return changes(old, new)

    slower, faster, within = against(12.1, 8.3), against(5.0, 20.0), against(11.9, 8.4)
    assert slower["time"].worse and slower["rate"].worse
    assert slower["time"].ratio == pytest.approx(1.21) and slower["rate"].ratio == pytest.approx(0.83)
    assert not any(c.worse for c in faster.values()) and not any(c.worse for c in within.values())
    assert slower["zero"].ratio is None and slower["share"].ratio == pytest.approx(9.0)
    assert not {"gone", "fresh", "other_unit"} & slower.keys()


def test_differences_name_machine_and_versions():
    now = sample()
    then = replace(now, processor="Z80", cores=now.cores + 1, versions={**now.versions, "numba": "0.1"}, date="2020")
    said = differences(then, now)
    assert [line.split(":")[0] for line in said] == ["processor", "cores", "numba"]
    assert "Z80 then" in said[0] and differences(now, now) == []


def test_the_command_compares_with_an_earlier_run(tmp_path, monkeypatch):
    monkeypatch.setattr(sections, "measure", lambda size: sample(margins_ms=Figure(0.2, "ms per gain set")).figures)
    then = replace(sample(), processor="Z80")
    write_json(tmp_path / "old.json", as_json(then))
    arguments = [
        "bench",
        "--out",
        tmp_path / "b.html",
        "--json",
        tmp_path / "new.json",
        "--compare",
        tmp_path / "old.json",
    ]
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    assert "worse" in result.output and "warning" in result.output and "Z80 then" in result.output
    assert read_results(tmp_path / "new.json").figures["margins_ms"].value == 0.2
    text = (tmp_path / "b.html").read_text()
    row = "<tr><td>margins ms</td><td>0.200</td><td>ms per gain set</td><td>0.100</td><td>2.00</td><td>worse</td></tr>"
    assert row in text and "Z80 then" in text


def test_a_page_without_comparison_has_no_such_column():
    text = bench_page(sample(), None)
    assert "<td>margins ms</td><td>0.100</td><td>ms per gain set</td></tr>" in text and "new / old" not in text


def broken(change):
    data = as_json(sample())
    change(data)
    return json.dumps(data)


BAD = {
    "not JSON": ("{", "not JSON"),
    "nested too deep": ("[" * 100_000, "not JSON"),
    "not text": (b"\xff\xfe\x00", "not JSON"),
    "a list": ("[1]", "schema"),
    "an earlier schema": ('{"schema": "maglev-bench/1"}', "schema = 'maglev-bench/1'"),
    "no versions": (broken(lambda d: d.pop("versions")), "versions is missing"),
    "cores in words": (broken(lambda d: d.update(cores="two")), "cores is missing or not a int"),
    "a bare number": (broken(lambda d: d["figures"].update(a=1.0)), "figures.a = '1.0' is not a table"),
    "nan": (
        broken(lambda d: d["figures"].update(a={"value": math.nan, "unit": "s", "better": None})),
        "figures.a: value",
    ),
    "no unit": (broken(lambda d: d["figures"].update(a={"value": 1, "better": None})), "figures.a: unit is missing"),
    "no better": (broken(lambda d: d["figures"].update(a={"value": 1, "unit": "s"})), "figures.a: better"),
    "too large": (" " * 1_000_001, "larger than"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_before_anything_is_measured(case, tmp_path, monkeypatch):
    monkeypatch.setattr(sections, "measure", lambda size: pytest.fail("measured"))
    content, message = BAD[case]
    path = tmp_path / "old.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    result = CliRunner().invoke(app, ["bench", "--out", str(tmp_path / "b.html"), "--compare", str(path)])
    assert result.exit_code == 2
    assert f"--compare {path}: " in result.output and message in result.output
    assert "maglev bench --json" in result.output
