"""Adjoints of phases that Warp does not derive alone, see `kernels.phase`."""
