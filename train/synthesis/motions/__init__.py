"""Procedural motion of synthetic people: programmes, scripts, and the solver that puts them on their feet."""
