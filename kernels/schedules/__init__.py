"""Who computes what, and where places are meanwhile: one module for each schedule. None knows a law."""
