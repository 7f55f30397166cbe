"""Competitors of the parameter estimator: an observer and a Kalman filter of the averaged magnet (D 2.6.2)."""
