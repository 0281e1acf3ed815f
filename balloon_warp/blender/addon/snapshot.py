"""Snapshot of a Blender scene for a bake, as plain numbers: no `bpy` is needed from here on."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

RIGID = 1e-4
"""Largest growth of what counts as rigid, over its size"""


class RefusedError(Exception):
    """A scene that cannot be baked; its sentence names the object."""


@dataclass
class Thing:
    """A mesh object that takes part, or an instance of one."""

    name: str
    settings: dict[str, Any]
    """Properties of its panel at the start, by their names"""
    points: NDArray[np.float64]
    """Points at the start in its own axes and units, shape (n, 3)"""
    counts: NDArray[np.int32]
    """Number of corners of each face"""
    corners: NDArray[np.int32]
    """Corners of all faces in order"""
    places: NDArray[np.float64]
    """Matrices from its own axes to the world's, one or one a frame, shape (1 or frames, 4, 4)"""
    pinned: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """Points that only the animation moves: a balloon's pin group, or all of an obstacle that bends"""
    paths: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 0, 3)))
    """Places of the pinned points in the world, shape (1 or frames, pinned, 3)"""
    amounts: list[float] = field(default_factory=list)
    """Volume, pressure [Pa] or litres that it is inflated to, of each frame; of the start alone where it stays"""
    anchors: NDArray[np.float64] | None = None
    """Places of the empty that its string is tied to, shape (1 or frames, 3)"""

    @property
    def role(self) -> str:
        """Role in the simulation: "BALLOON", "OBSTACLE" or "BODY"."""
        return self.settings["role"]

    @property
    def bends(self) -> bool:
        """Return whether the thing is an obstacle that moves point by point."""
        return self.role == "OBSTACLE" and len(self.pinned) > 0

    @property
    def bursts(self) -> bool:
        """Return whether the thing is a balloon that may burst: springs do not tear."""
        settings = self.settings
        return self.role == "BALLOON" and settings["burst"] != "NEVER" and settings["material"] != "SPRINGS"


@dataclass
class Snapshot:
    """A Blender scene, as far as a bake needs it."""

    things: list[Thing]
    """Objects that take part, balloons first"""
    first: int
    """Number that Blender gives the start"""
    frames: int
    """Number of frames after the start"""
    frames_per_second: float
    meters: float
    """Length of Blender's unit [m]"""
    gravities: NDArray[np.float64]
    """Downward acceleration, in Blender's units [1/s^2], shape (1 or frames,)"""
    settings: dict[str, Any]
    """Properties of the scene's panel, by their names"""
    winds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    """Wind of all force fields [m/s], shape (1 or frames, 3)"""
    remarks: list[str] = field(default_factory=list)
    """Sentences on what the bake leaves out"""


def is_rigid(places: NDArray[np.float64]) -> bool:
    """Return whether matrices of shape (n, 4, 4) differ by turns and shifts alone."""
    turns = np.array([place[:3, :3] @ np.linalg.pinv(places[0, :3, :3]) for place in places])
    return bool(np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() <= RIGID)


def in_world(points: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points in the world, of an object with this matrix."""
    return points @ place[:3, :3].T + place[:3, 3]
