"""A study: one tuner on one rig, kept on disk, and which of its gains to recommend."""
