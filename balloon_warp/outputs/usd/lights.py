"""The studio's lights: three softboxes around the subject and a dim sky, placed as the camera sees them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

Color = tuple[float, float, float]


class Softbox(NamedTuple):
    """A rectangular lamp that faces the subject. Lengths are in sizes of the subject."""

    toward: tuple[float, float, float]
    """Direction from the subject: right, up, and back, as the camera sees it unless the light is turned"""
    distance: float
    width: float
    height: float
    power: float
    """Intensity at a subject of size 1: the total power, whatever its size"""
    color: Color = (1.0, 1.0, 1.0)


SOFTBOXES = {
    "Key": Softbox((-0.62, 1.0, 0.62), 4.0, 1.7, 2.2, 30.0, (1.0, 0.97, 0.92)),
    "Rim": Softbox((0.9, 0.62, -0.3), 4.0, 0.6, 4.4, 20.0, (0.95, 0.98, 1.0)),
    "Top": Softbox((0.0, 1.0, 0.0), 6.0, 5.0, 5.0, 8.0),
}
SKY, SKY_COLOR = 0.1, (0.90, 0.95, 1.0)
"""Intensity and color of the uniform sky"""


def define_lights(
    stage: Usd.Stage, home: Sdf.Path, center: NDArray[np.float64], level_axes: NDArray[np.float64], size: float
) -> None:
    """Define sky and softboxes below a prim, in whose coordinates Y is up.

    Args:
        center: the subject's middle, shape (3,).
        level_axes: unit vectors by which directions to lamps are given, a row each, shape (3, 3).
        size: of the subject.
    """
    sky = UsdLux.DomeLight.Define(stage, home.AppendChild("Sky"))
    sky.CreateIntensityAttr(SKY)
    sky.CreateColorAttr(Gf.Vec3f(*SKY_COLOR))
    for name, box in SOFTBOXES.items():
        light = UsdLux.RectLight.Define(stage, home.AppendChild(name))
        light.CreateNormalizeAttr(True)
        light.CreateIntensityAttr(box.power * size**2)
        light.CreateColorAttr(Gf.Vec3f(*box.color))
        light.CreateWidthAttr(box.width * size)
        light.CreateHeightAttr(box.height * size)
        toward = np.array(box.toward) @ level_axes / np.linalg.norm(box.toward)
        matrix = np.eye(4)
        matrix[:3, :3] = _facing(toward)
        matrix[3, :3] = center + box.distance * size * toward
        UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _facing(backward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes of a lamp that shines against a direction, a row each: to its right, up and backward."""
    straight = abs(backward[1]) > 0.99
    right = np.cross([0.0, 0.0, -1.0] if straight else [0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(backward, right), backward])
