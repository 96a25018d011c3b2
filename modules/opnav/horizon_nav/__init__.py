"""Position relative to a body from points of its limb."""

from modules.opnav.horizon_nav.module import HorizonNav

__all__ = ["HorizonNav"]
