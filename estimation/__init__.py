"""Estimators: signals in; stiffness, damping and stability out, with their uncertainty. They know no rig.

Each module is imported from its own name, so that nobody waits for estimators that he does not call.
"""
