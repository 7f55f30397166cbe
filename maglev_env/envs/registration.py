"""Environment ids, registered on import of `maglev_env`, which `gymnasium.make("maglev_env:ID")` does by itself."""

from gymnasium.envs.registration import register, registry

IDS = {
    "maglev/HMBFree-v0": "hmb_free",
    "maglev/HMBRadial-v0": "hmb_radial",
    "maglev/EFrame-v0": "eframe",
    "maglev/Rig-v0": None,  # any rig TOML: rig = path
}


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for name, rig in IDS.items():
        if name not in registry:
            register(
                name,
                entry_point="maglev_env.envs.single:RigEnv",
                vector_entry_point="maglev_env.envs.vector:RigVectorEnv",
                kwargs={} if rig is None else {"rig": rig},
            )
