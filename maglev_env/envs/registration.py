"""Environment ids, registered on import of `maglev_env`, which `gymnasium.make("maglev_env:ID")` does by itself."""

from gymnasium.envs.registration import register, registry

IDS = {
    "maglev/HMBFree-v0": "hmb_free",
    "maglev/HMBRadial-v0": "hmb_radial",
    "maglev/EFrame-v0": "eframe",
    "maglev/Rig-v0": None,  # any rig TOML: rig = path
    "maglev/PumpRotor-v0": None,  # the pump, or any rotor TOML: rotor = path
}
_ENTRY_POINTS = {"maglev/PumpRotor-v0": ("pump:PumpRotorEnv", "pump:PumpRotorVectorEnv")}


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for name, rig in IDS.items():
        if name not in registry:
            single, vector = _ENTRY_POINTS.get(name, ("single:RigEnv", "vector:RigVectorEnv"))
            register(
                name,
                entry_point=f"maglev_env.envs.{single}",
                vector_entry_point=f"maglev_env.envs.{vector}",
                kwargs={} if rig is None else {"rig": rig},
            )
