"""Calibrate the cameras of a session, from files and folders to a calibration."""
