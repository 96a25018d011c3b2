"""Guidance: reference attitudes and tracking errors."""
