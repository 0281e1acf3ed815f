"""The camera: a pinhole, the stage's own or one that frames the action, and the stage at one point in time."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

Z_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation of row vectors with Z up into ones with Y up"""


class Moment:
    """Moment of a stage: places of prims at a time code, Y up, in the stage's unit."""

    def __init__(self, stage: Usd.Stage, time: float):
        self.time = Usd.TimeCode(time)
        self._xforms = UsdGeom.XformCache(self.time)
        self._turn = Z_TO_Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else np.eye(3)

    def place(self, prim: Usd.Prim, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return a prim's points in the world, shape (n, 3)."""
        matrix = self._matrix(prim)
        return (points.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]) @ self._turn

    def scale(self, prim: Usd.Prim) -> float:
        """Return the factor on lengths from the prim to the world: the cube root of the change in volume."""
        return float(np.cbrt(abs(np.linalg.det(self._matrix(prim)[:3, :3]))))

    def is_frame(self, matrix: Gf.Matrix4d) -> bool:
        """Return whether a matrix is finite and its x, y and z axes span space."""
        rows = np.array(matrix)
        lengths = np.linalg.norm(rows[:3, :3], axis=1)
        if not (np.isfinite(rows).all() and lengths.all()):
            return False
        return bool(abs(np.linalg.det(rows[:3, :3] / lengths[:, None])) > 1e-6)

    def axes(self, matrix: Gf.Matrix4d) -> NDArray[np.float64]:
        """Return the unit vectors along the x, y and z axes of a frame, a row each, shape (3, 3)."""
        rows = np.array(matrix)[:3, :3]
        return rows / np.linalg.norm(rows, axis=1, keepdims=True) @ self._turn

    def origin(self, matrix: Gf.Matrix4d) -> NDArray[np.float64]:
        """Return the position of a frame's origin, shape (3,)."""
        return np.array(matrix)[3, :3] @ self._turn

    def _matrix(self, prim: Usd.Prim) -> NDArray[np.float64]:
        return np.array(self._xforms.GetLocalToWorldTransform(prim))


VERTICAL_VIEW = np.radians(26.0)
"""Vertical angle of view, as of a portrait lens"""
AZIMUTH = 32.0
"""Azimuth of a three-quarter view, from the front (+Z) toward +X [degrees]"""
ELEVATION = 13.0
"""Elevation above the horizon [degrees]"""
KEY_AZIMUTH = -45.0
"""Azimuth of the main light from the camera toward its right [degrees]: over the photographer's left shoulder"""
MARGIN = 0.80
"""Fraction of the picture's half size within which the action stays"""


@dataclass(frozen=True)
class Camera:
    """Camera of a picture, Y up, in the stage's unit."""

    eye: NDArray[np.float64]
    """Position, shape (3,)"""
    axes: NDArray[np.float64]
    """Unit vectors to the right, up and backward, a row each, shape (3, 3)"""
    half_width: float
    """Half the picture's width at distance one"""
    half_height: float
    """Half the picture's height at distance one"""
    aperture: float = 0.0
    """Diameter of the lens; 0 for a pinhole"""
    focus: float = 1.0
    """Distance in focus"""

    def pixel_size(self, place: NDArray[np.float64], height: int) -> float:
        """Return the size of a pixel at a place, in a picture `height` pixels high."""
        distance = float(abs((self.eye - place) @ self.axes[2]))
        return 2.0 * self.half_height * distance / height

    @property
    def level_axes(self) -> NDArray[np.float64]:
        """Unit vectors to the right, up, and level back toward the camera, a row each, shape (3, 3)."""
        right, _, backward = self.axes
        across = np.array([right[0], 0.0, right[2]])
        across /= np.linalg.norm(across)
        level = np.cross(across, [0.0, 1.0, 0.0])
        return np.stack([across, [0.0, 1.0, 0.0], level if level @ backward >= 0.0 else -level])

    def looking_at(self, middle: NDArray[np.float64], center: NDArray[np.float64]) -> "Camera":
        """Return the camera moved aside, at its distance from `center`, so that `middle` is in the picture's middle."""
        distance = float((self.eye - center) @ self.axes[2])
        return replace(self, eye=middle + distance * self.axes[2])

    def zoomed(self, zoom: float) -> "Camera":
        """Return the camera with a lens that shows everything `zoom` times as large."""
        return replace(self, half_width=self.half_width / zoom, half_height=self.half_height / zoom)


class CameraFit:
    """Finds the camera nearest to the action that still has it all in the picture, for a fixed direction of view.

    A sphere of radius r about c is inside the pyramid of view when n.(c - eye) >= r for each of the pyramid's four
    inward unit normals n. Only the least n.c - r over all spheres matters, so the action is taken in piece by piece.

    Args:
        aspect: the picture's width over its height.
        azimuth: where one looks from, from the front (+Z) toward +X [degrees].
        elevation: from level toward above [degrees].
    """

    def __init__(self, aspect: float, azimuth: float = AZIMUTH, elevation: float = ELEVATION):
        around, above = np.radians([float(azimuth), float(elevation)])
        self.half_height = float(np.tan(VERTICAL_VIEW / 2.0))
        self.half_width = self.half_height * aspect
        backward = np.array([np.sin(around) * np.cos(above), np.sin(above), np.cos(around) * np.cos(above)])
        right = np.array([np.cos(around), 0.0, -np.sin(around)])
        self.axes = np.stack([right, np.cross(backward, right), backward])
        half = MARGIN * np.array([self.half_width, self.half_height])
        self._cosines = 1.0 / np.hypot(1.0, half)
        self._sines = half * self._cosines
        self._support = np.full((2, 2), np.inf)

    def include(self, centers: NDArray[np.float64], radii: NDArray[np.float64] | float = 0.0) -> None:
        """Take in spheres: centers of shape (n, 3), radii of shape (n,) or one for all."""
        seen = centers @ self.axes.T
        for axis in range(2):
            inward = -self._sines[axis] * seen[:, 2] - radii
            across = self._cosines[axis] * seen[:, axis]
            for side, sign in enumerate((1.0, -1.0)):
                least = float(np.min(sign * across + inward, initial=np.inf))
                self._support[axis, side] = min(self._support[axis, side], least)

    def camera(self) -> Camera:
        """Return the camera for all that was taken in."""
        middle = (self._support[:, 0] - self._support[:, 1]) / (2.0 * self._cosines)
        back = -self._support.sum(axis=1) / (2.0 * self._sines)
        eye = np.array([*middle, back.max()]) @ self.axes
        return Camera(eye, self.axes, self.half_width, self.half_height)


def turned(level_axes: NDArray[np.float64], light: float) -> NDArray[np.float64]:
    """Return a camera's level axes, shape (3, 3), turned so that its main light comes from an azimuth [degrees].

    A studio lit from the right is the mirror image of one lit from the left: its other lamp must not get behind the
    scene, whose outlines would shine.
    """
    right, up, backward = level_axes
    if light > 0.0:
        right, light = -right, -light
    angle = np.radians(light - KEY_AZIMUTH)
    return np.stack(
        [np.cos(angle) * right - np.sin(angle) * backward, up, np.sin(angle) * right + np.cos(angle) * backward]
    )
