"""Synthetic training data, the training of the networks, and their evaluation."""
