"""Recorded walks: what the sensors sent, the rig, and the truth.

Everything is on the LiDAR's clock in integer nanoseconds; points are in the LiDAR's frame in metres, IMU samples in the
IMU's frame in m/s^2 and rad/s.
"""
