"""Compilation of numerical kernels, with the same settings everywhere."""

from __future__ import annotations

from numba import njit

compiled = njit(cache=True, nogil=True, error_model="numpy")
