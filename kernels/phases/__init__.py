"""Phases of a substep, each in a file; `kernels.substep` lists them in order."""
