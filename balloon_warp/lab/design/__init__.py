"""Designs: the balloon that becomes a given shape, of springs, latex or foil."""
