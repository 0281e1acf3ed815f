"""Measurements of worlds: volumes, masses, forces, and the rows of a batch's table."""
