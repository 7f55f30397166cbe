"""The model-corrected tuner: a fitted rig, what measurements differ from it, and the search on both together."""
