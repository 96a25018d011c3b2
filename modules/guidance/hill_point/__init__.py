"""Reference attitude that follows the orbit."""

from modules.guidance.hill_point.module import HillPoint

__all__ = ["HillPoint"]
