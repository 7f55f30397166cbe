"""The step is made of vector instructions in every variant of the kernel: a loop that falls back to single numbers
would cost three to four times as much, and no result would show it."""

import re
from dataclasses import replace

import numba as nb
import pytest
from llvmlite import binding

from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.advance import kernel
from maglev_env.kernel.lanes import structure_of
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig

pytestmark = pytest.mark.skipif(
    not binding.get_host_cpu_features().get("avx"),
    reason="this processor has no AVX: its instructions have other names",
)
ONE = protocol_experiment(load_rig("hmb_free"))
XY = replace(ONE, rig=replace(ONE.rig, axes=2))
COUPLED = replace(XY, rig=replace(XY.rig, cross=Cross(stiffness_xy=100.0, gain_yx=0.1, damping_xy=0.1, sensor_yx=0.01)))
SUPPORTED = replace(ONE, rig=replace(ONE.rig, support_stiffness=1e4, support_damping=5.0))
BALL = replace(ONE, rig=Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4))
STICKING = effect("eddy_current", 1e3) | effect("friction", force=0.02, presliding=1e-6)


def with_effects(e, **values):
    return replace(e, effects={name: v for key, value in values.items() for name, v in effect(key, value).items()})


NO_LAG = replace(SUPPORTED, rig=replace(SUPPORTED.rig, amplifier_time_constant=0.0))
# Kernels that other tests run too, as far as possible: each is compiled once.
VARIANTS = {
    "supported": SUPPORTED,
    "delay": with_effects(ONE, delay=75e-6),
    "delay and a support without amplifier": with_effects(NO_LAG, delay=6e-5),
    "delay, second poles and a support": with_effects(SUPPORTED, amplifier_lag=1e-4, sensor_lag=1e-5, delay=75e-6),
    "saturation and another exponent": with_effects(ONE, saturation=1.5, force_law=0.1),
    "electromagnet, another exponent": replace(BALL, rig=replace(BALL.rig, force_exponent=3.0, bias_current=0.5)),
    "x-y": XY,
    "x-y, coupled": COUPLED,
    "flexible": with_effects(ONE, eddy_current=1e3),
    "sticking": replace(ONE, effects=STICKING),
    "further": with_effects(ONE, asymmetric_gain=0.1),
    "free": with_effects(ONE, free_current=0.1),
    "flexible x-y, coupled": with_effects(COUPLED, eddy_current=1e3),
    "self-sensing": replace(ONE, sensor="self_sensing"),
}


def assembly(e):
    """Of the kernel; for one that comes from the disk cache, of the optimised code that the cache keeps beside it."""
    numbers, whole = nb.float64[::1], nb.int64[::1]
    own = (numbers, nb.uint64[::1], numbers, nb.int64, whole, whole, whole, *[numbers] * 4)
    step = kernel(structure_of(e))
    step.compile(own)
    if not step.stats.cache_hits:
        return step.inspect_asm(own)
    library = step.overloads[own].library
    return library.codegen._tm.emit_assembly(library._shared_module)


def count(text, names, kind):
    return len(re.findall(rf"\bv(?:{names}){kind}\b", text))


def check(e):
    text = assembly(e)
    arithmetic = "mul|add|sub|fn?m(?:add|sub)[0-9]+"
    assert count(text, arithmetic, "pd") > count(text, arithmetic, "sd")
    # The pull divides in every step, and but for the clocks of self-sensors no single number is ever divided.
    assert count(text, "div", "pd") >= 3
    assert e.sensor != "probe" or count(text, "div", "sd") == 0


def test_the_plain_step_is_made_of_vector_instructions():
    check(ONE)


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_step_is_made_of_vector_instructions(variant):
    check(VARIANTS[variant])
