"""Loops over the forces on a particle. They know neither laws nor storage: a function `at` reads points."""
