"""Loops over what acts on a particle. They know no law, and not where the points are: a function `at` reads those."""
