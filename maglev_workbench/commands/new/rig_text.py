"""A skeleton of rig.toml: what the magnet kind needs, to be stated by the engineer."""

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from maglev_env.loop.magnets.kinds import KINDS, MAGNETS, NO_MAGNET
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.rig.rig_file import SCHEMA, load_rig
from maglev_workbench.commands.new.campaign_text import PLEASE
from maglev_workbench.commands.new.stated import Stated

_COIL = {
    "turns": "200", "pole_area": "1e-4         # m2", "gap": "1e-3               # m, at the operating point",
    "clearance": "1e-3         # m, to touchdown", "bias_current": "1.0       # A",
}  # fmt: skip
_BELOW = {
    **{name: _COIL[name] for name in ("gap", "clearance")},
    "bias_current": "1.0       # A, carries the weight at the gap, or turns and pole_area, or force_constant",
}
_NEEDED: Mapping[str, Mapping[str, str]] = {
    "hybrid_pair": {
        **{name: text for name, text in _COIL.items() if name != "bias_current"},
        "magnet_area": "1e-4       # m2", "magnet_length": "5e-3     # m", "remanence": "1.2          # T",
    },
    "electromagnet_pair": _COIL,
    "electromagnet": _BELOW,
    "magnet_coil": {
        "force_constant": "2e-8    # N m^n / A", "force_exponent": "4.0", "coil_inductance": "1e-2   # H",
        "gap": "1e-2               # m, at the operating point", "clearance": "5e-3         # m, to touchdown",
    },
    NO_MAGNET: {"support_stiffness": "1e4  # N/m", "support_damping": "1.0    # N s/m"},
}  # fmt: skip


# What a recording cannot do without in the simulation, whatever the magnet.
_CHAIN = (
    "adc_bits = 0              # no converter cuts off or rounds: or state adc_bits, dac_bits, voltage_range (V) and",
    "dac_bits = 0              # probe_gain (V/m), whose defaults are 16, 14, 10 and 8000",
    "# sensor_time_constant = 1e-5     # s, filter of the probe: {please} yours (left out: estimate fits it)",
)
_DRIVEN = (
    "# amplifier_time_constant = 1e-4  # s, from command to current: {please} yours (left out: estimate fits it)",
    "# actuator_gain = 1.0         # N/A, where it was measured: {please} yours",
    "# negative_stiffness = -1e3   # N/m, likewise: {please} yours",
)


_SEAL = "# --force may replace this file as long as its text fits this number: "


def _sealed(text: str) -> str:
    """The text with a last line by which any later change shows."""
    return f"{text}{_SEAL}{sha256(text.encode()).hexdigest()[:16]}\n"


def is_untouched(path: Path) -> bool:
    """Whether a file is a skeleton exactly as it was written; any other is the user's."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False
    return text == _sealed(text.rpartition(_SEAL)[0])


def fault_of(path: Path) -> str:
    """Why a file is no rig; "" where it is one."""
    try:
        load_rig(path)
    except (OSError, ValueError) as error:
        return str(error)
    return ""


def is_filled_in(path: Path) -> bool:
    """Whether a file is a rig with a magnet, or without one a support, that no skeleton states by itself."""
    try:
        rig = load_rig(path)
    except (OSError, ValueError):
        return False
    return rig.controlled or rig.support_stiffness > 0


def rig_text(
    stated: Stated,
    gains: Mapping[str, Any] | None,
    control_rate: float | None,
    suspended: bool = False,
    driven: bool = False,
    axes: int = 1,
) -> str:
    """The skeleton; what is known stands, the rest is commented out with a value of the usual form.

    Args:
        stated: mass and magnet kind, where the user stated them.
        gains: the controller, where a recording shows it.
        control_rate: Hz, where a recording shows that its controller runs at its sample rate.
        suspended: whether the recordings show a rotor that hangs below a single magnet.
        driven: whether they hold a command or a current.
        axes: how many axes they have.
    """
    magnet = stated.magnet or ("electromagnet" if suspended else "electromagnet_pair" if driven else NO_MAGNET)
    chosen = f'magnet = "{magnet}"' if stated.magnet else f'# magnet = "{magnet}"  # {PLEASE} {", ".join(MAGNETS)}'
    mass = f"mass = {stated.mass!r}" if stated.mass is not None else f"# mass = 0.1                 # {PLEASE} kg"
    lines = [
        "# A skeleton: take the # from a line when its value is right, then name this file in campaign.toml. Below one",
        "# magnet rather run maglev new again with --rig and --force: it states bias and gap in the channels.",
        f'schema = "{SCHEMA}"',
        'name = "mine"',
        *(["axes = 2"] if axes == 2 else []),
        chosen,
        "",
        "[parameters]  # SI; all keys: docs/formats.md",
        mass,
        *(f"# {name} = {text}  # {PLEASE} yours" if "#" not in text else f"# {name} = {text}: {PLEASE} yours"
          for name, text in _NEEDED[magnet].items()),
    ]  # fmt: skip
    if control_rate:
        lines.append(f"control_rate = {control_rate!r}    # Hz: the command follows the displacement sample by sample")
    else:
        lines.append(f"# control_rate = 20000.0      # Hz: {PLEASE} yours")
    lines += [line.format(please=PLEASE) for line in (*_CHAIN, *(_DRIVEN if magnet in KINDS else ()))]
    if gains:
        found = (f"{name} = {toml_value(value)}" for name, value in gains.items())
        lines += ["", "[gains]  # found in the recordings", *found]
    lines += ["", "[tolerance]  # relative 1-sigma uncertainty of what you know", "# mass = 0.005"]
    return _sealed("\n".join(lines) + "\n")
