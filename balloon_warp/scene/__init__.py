"""Scenes: what a TOML file says, checked, with overrides and defaults applied."""

from balloon_warp.scene.load import SceneLike, bundled_scenes, load_scene, scene_of
from balloon_warp.scene.schema import (
    Atmosphere,
    Balloon,
    Body,
    Box,
    Change,
    Ground,
    Inflation,
    Material,
    Obstacle,
    Scene,
    Sphere,
    Stiffness,
    String,
    Touch,
    Tube,
    Water,
)

__all__ = [
    "Atmosphere",
    "Balloon",
    "Body",
    "Box",
    "Change",
    "Ground",
    "Inflation",
    "Material",
    "Obstacle",
    "Scene",
    "SceneLike",
    "Sphere",
    "Stiffness",
    "String",
    "Touch",
    "Tube",
    "Water",
    "bundled_scenes",
    "load_scene",
    "scene_of",
]
