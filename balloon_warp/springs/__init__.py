"""Structural, shear and flexion springs from a mesh's topology."""

from balloon_warp.springs.build import build_springs
from balloon_warp.springs.springs import SpringKind, Springs

__all__ = ["SpringKind", "Springs", "build_springs"]
