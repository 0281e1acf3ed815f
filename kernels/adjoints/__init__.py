"""Adjoints of phases that are not derived by Warp alone, see `kernels.adjoint`."""
