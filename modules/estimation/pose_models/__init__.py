"""What the sensors of a pose measure, and its derivatives: shared by the filters of position and attitude.

The pose is position and velocity in N, attitude dcm_BN and angular rate omega_BN_B. Its error state has 12 numbers:
dr, dv [m, m/s, N], theta, domega [rad, rad/s, B], with the true attitude (I - [theta x]) dcm_BN. Every model writes its
rows of derivatives H (m, 12) by that error, whatever a filter's own state; a filter with other states multiplies by
the derivative of this error by its own.
"""
