"""Synthetic people, the training loops and their evaluation. Needs the `train` extra."""
