"""Fits: the values of a scene, or the rubber, that something measured was."""
