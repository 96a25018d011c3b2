"""Truth of actuators: what they do when they are commanded, and what the spacecraft feels of it."""
