"""Schedules: the work of each thread, and the memory of points meanwhile, a module each; none knows a law."""
