"""Snapshot of a Blender scene for a bake, as plain numbers: no `bpy` is needed from here on."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


class RefusedError(Exception):
    """A scene that cannot be baked; its sentence names the object."""


@dataclass
class Thing:
    """A mesh object that takes part."""

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
    """Points that do not move"""
    amounts: list[float] = field(default_factory=list)
    """Volume, pressure [Pa] or litres that it is inflated to, of each frame; of the start alone where it stays"""
    anchors: NDArray[np.float64] | None = None
    """Places of the empty that its string is tied to, shape (1 or frames, 3)"""

    @property
    def role(self) -> str:
        """Role in the simulation: "BALLOON", "OBSTACLE" or "BODY"."""
        return self.settings["role"]


@dataclass
class Snapshot:
    """A Blender scene, as far as a bake needs it."""

    things: list[Thing]
    frames: int
    """Number of frames after the start"""
    frames_per_second: float
    meters: float
    """Length of Blender's unit [m]"""
    gravity: float
    """Downward acceleration, in Blender's units [1/s^2]"""
    settings: dict[str, Any]
    """Properties of the scene's panel, by their names"""
    winds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    """Wind of all force fields [m/s], shape (1 or frames, 3)"""
