"""The take that the demo runs on."""
