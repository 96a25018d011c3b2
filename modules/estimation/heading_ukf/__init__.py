"""Direction to a body and the body rates across it, from positions relative to the body."""

from modules.estimation.heading_ukf.module import HeadingUkf

__all__ = ["HeadingUkf"]
