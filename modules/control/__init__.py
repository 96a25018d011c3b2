"""Control: commands for actuators."""
