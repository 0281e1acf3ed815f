"""Kernels of the implicit solver."""
