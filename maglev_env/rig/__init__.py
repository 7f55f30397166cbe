"""A rig: its parameters, its controllers and the excitation of its experiment."""
