"""A list of phases as launches of kernels."""
