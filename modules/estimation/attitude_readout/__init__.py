"""Attitude from star tracker and gyro."""

from modules.estimation.attitude_readout.module import AttitudeReadout

__all__ = ["AttitudeReadout"]
