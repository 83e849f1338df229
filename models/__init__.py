"""The networks, the decoding of their outputs, and the shipped weights."""
