"""Phases of a substep, by theme; `kernels.substep` lists them in order."""
