"""The scene schema: every field, its unit, its default and its bounds. SI units throughout.

scene          a scene as a whole: time, methods, and the lists of what is in it
balloon        balloons, their springs and what fills them
material       rubber and film
bodies         spheres and strings
obstacles      rigid things in the way
rigid          rigid bodies that move freely
surroundings   air, water and ground; where a batch counts; from where pictures are taken
touch          balloons that touch
fields         what all of these are made of
"""

from balloon_warp.scene.schema.balloon import Balloon, Inflation, Material, Neck, Stiffness, Touch
from balloon_warp.scene.schema.scene import (
    MESHED,
    WITHOUT_MESHES,
    Atmosphere,
    Body,
    Box,
    Change,
    Force,
    Ground,
    Obstacle,
    Picture,
    Scene,
    Sphere,
    String,
    Tube,
    Water,
)

__all__ = [
    "MESHED",
    "WITHOUT_MESHES",
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
    "Picture",
    "Scene",
    "Sphere",
    "Stiffness",
    "String",
    "Touch",
    "Tube",
    "Water",
]
