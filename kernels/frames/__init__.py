"""Kernels that run once a frame, besides the list of phases."""
