"""Sensors: true states in, measurements with their errors out."""
