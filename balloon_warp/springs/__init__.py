"""Structural, shear and flexion springs from a mesh's topology."""

from balloon_warp.springs.build import SpringKind, Springs, build_springs

__all__ = ["SpringKind", "Springs", "build_springs"]
