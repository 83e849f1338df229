"""Markerless motion capture from a few calibrated cameras."""

__version__ = "0.1.0"
