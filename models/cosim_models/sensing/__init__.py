"""Sensors and the estimator."""
