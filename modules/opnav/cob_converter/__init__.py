"""Direction of a body from its centre of brightness."""

from modules.opnav.cob_converter.module import CobConverter

__all__ = ["CobConverter"]
