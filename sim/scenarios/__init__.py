"""Scenarios: the only place that sees both sides, flight software and truth."""
