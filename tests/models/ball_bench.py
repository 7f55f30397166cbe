"""A ball below its coil, by Runge-Kutta steps, under a controller run as a program, with noise in what it reads."""

import re
from pathlib import Path

import numpy as np
from textbook_controllers import by_hand

from maglev_env.rig.rig_file import rig_from_toml

DOCS = Path(__file__).parents[2] / "docs" / "controllers.md"
# The rig of the example in the documentation.
BALL = next(t for t in re.findall(r"```toml\n(.*?)```", DOCS.read_text("utf-8"), re.S) if "ball under PID" in t)
STEPS = 10  # integration steps in a control step
MU_0 = 4e-7 * np.pi


def record(rig, seconds, seed, injection=None, reference=None, noise=(1e-6, 1e-3), gain=1.0, lasts=None):
    """Displacement (m), command, current (A) of one run; noise: rms of what is read (m, A); gain: on K.

    The ticks of the controller last so many control steps each, `lasts` (samples,); it knows nothing of that.
    """
    rng, dt = np.random.default_rng(seed), 1 / rig.control_rate
    n = int(seconds * rig.control_rate)
    injection = np.zeros(n) if injection is None else injection
    reference = np.zeros(n) if reference is None else reference
    k = gain * rig.bearings * MU_0 * rig.turns**2 * rig.pole_area / 4
    weight = rig.mass * rig.gravity
    bias = rig.gap * np.sqrt(weight / (k / gain))
    tick, spans = by_hand(rig.gains, dt), (np.ones(n) if lasts is None else lasts) * dt / STEPS

    def slope(y, v, i, z, u):
        pull = k * ((bias + i) / (rig.gap - y)) ** 2 - weight
        return v, pull / rig.mass, (u - i) / rig.amplifier_time_constant, (y - z) / rig.sensor_time_constant

    def moved(x, a, span):
        return [value + span * rate for value, rate in zip(x, a, strict=True)]

    x, found = [0.0] * 4, np.empty((3, n))
    for t, (e_y, e_i) in enumerate((rng.normal(size=(n, 2)) * noise).tolist()):
        read, current = x[3] + e_y, x[2] + e_i
        u = float(tick(reference[t], read, current) + injection[t])
        found[:, t], h = (read, u, current), spans[t]
        for _ in range(STEPS):
            a = slope(*x, u)
            b = slope(*moved(x, a, h / 2), u)
            c = slope(*moved(x, b, h / 2), u)
            d = slope(*moved(x, c, h), u)
            x = [value + h / 6 * (p + 2 * q + 2 * r + s) for value, p, q, r, s in zip(x, a, b, c, d, strict=True)]
    return dict(zip(("displacement", "command", "current"), found, strict=True))


def write_campaign(folder: Path, rig_text: str, controller: str, runs, channels=("displacement", "command", "current")):
    """A campaign of runs {name: channels} with one controller (TOML) and no stated excitation."""
    rig = rig_from_toml(rig_text, "rig.toml")
    (folder / "rig.toml").write_text(rig_text)
    text = ['schema = "maglev-campaign/1"', 'rig = "rig.toml"']
    for name, run in runs.items():
        np.savez(folder / f"{name}.npz", **run)
        text += ["[[recording]]", f'file = "{name}.npz"', f"sample_rate = {rig.control_rate}"]
        text += [f"controller = {controller}", 'excitation = { kind = "none" }', "[recording.channels]"]
        text += [f'{channel} = {{ from = "{channel}" }}' for channel in channels if channel in run]
    (folder / "campaign.toml").write_text("\n".join(text))
    return folder
