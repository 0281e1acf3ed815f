"""Derivatives of a loss on a simulation by values of its scene."""
