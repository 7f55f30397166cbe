"""A rig whose identification takes a fraction of a second, and sweeps of it."""

from dataclasses import replace

from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from tuning.axis import Axis
from tuning.sweep import Sweep


def short_rig() -> Rig:
    """hmb_free with a period of 50 ms."""
    rig = load_rig("hmb_free")
    excitations = (
        Excitation("sphs", "force", 20.0, tuple(n for n in range(1, 24) if n % 3), 0.3),
        Excitation("sphs", "current", 20.0, (3, 6, 9, 15, 21, 30, 45, 60, 80, 100), 0.1),
    )
    protocol = replace(rig.protocol, excitations=excitations, band_width=120.0, band_overlap=60.0)
    return replace(rig, protocol=protocol, target=replace(rig.target, band=(20.0, 140.0)))


def short_sweep(rig: Rig, **changes: object) -> Sweep:
    """20 gain sets, one argument of the sweep or another changed."""
    axes = {"kp": Axis(4000.0, 12000.0, 4), "kd": Axis(0.5, 8.0, 5)}
    return Sweep(rig, **({"axes": axes, "seed": 3} | changes))
