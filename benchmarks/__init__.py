"""Benchmarks: speed of the schedules, side by side with a peer."""
