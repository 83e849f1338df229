"""Motions one behind the other: where they are joined, and how one goes over into the next."""
