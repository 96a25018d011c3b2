"""The true world: dynamics, environment, sensors, cameras, and the scenarios that wire it to flight software."""
