"""Measurements of worlds: health, volumes, masses and the rows of a batch's table."""
