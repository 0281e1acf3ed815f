"""Derivatives of what comes of a scene by what it says."""
