"""Cameras, calibration, triangulation, skeleton and inverse kinematics: pure functions on arrays."""
