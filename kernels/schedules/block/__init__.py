"""A thread block a world."""
