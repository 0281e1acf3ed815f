"""Warp kernels and functions: the physics and the ray caster, and nothing else. Imports warp alone."""
