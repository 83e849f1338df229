"""Calibrations of data sets and renderers in JSON: one module each."""
