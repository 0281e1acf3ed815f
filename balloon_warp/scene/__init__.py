"""Scenes: the contents of a TOML file, checked, with overrides and defaults applied. SI units throughout.

Read `scene` first, a scene as a whole, its surroundings and solids; `balloon` has balloons, their materials and what
fills them, `fields` what the fields of both are made of, with materials and air that are known, and `load` the way from
a file and back.
"""

from balloon_warp.scene.balloon import Balloon, Inflation, Material, Neck, Stiffness, Touch
from balloon_warp.scene.load import SceneLike, bundled_scenes, load_scene, scene_of
from balloon_warp.scene.scene import (
    Atmosphere,
    Body,
    Box,
    Change,
    Force,
    Ground,
    Obstacle,
    Scene,
    Sphere,
    String,
    Tube,
    Water,
)

__all__ = [
    "Atmosphere",
    "Balloon",
    "Body",
    "Box",
    "Change",
    "Force",
    "Ground",
    "Inflation",
    "Material",
    "Neck",
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
