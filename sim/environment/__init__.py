"""The truth side around the spacecraft: bodies, light, magnetic field, air."""
