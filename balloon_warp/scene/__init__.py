"""Scenes: what a TOML file says, checked, with overrides and defaults applied."""

from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.scene.schema import Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness, String, Water

__all__ = [
    "Balloon",
    "Change",
    "Ground",
    "Inflation",
    "Scene",
    "Sphere",
    "Stiffness",
    "String",
    "Water",
    "bundled_scenes",
    "load_scene",
]
