"""Attitude from any number of directions."""

from modules.estimation.q_method.module import QMethod

__all__ = ["QMethod"]
