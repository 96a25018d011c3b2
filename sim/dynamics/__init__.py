"""Dynamics: how the true state moves."""
