"""Estimators: states of the vehicle from measurements."""
