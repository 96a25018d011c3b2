"""Position, velocity, attitude, gyro bias and errors of the sensors by a multiplicative filter: `PoseMekf`."""

from modules.estimation.pose_mekf.module import PoseMekf
from modules.estimation.pose_mekf.params import PoseMekfParams

__all__ = ["PoseMekf", "PoseMekfParams"]
