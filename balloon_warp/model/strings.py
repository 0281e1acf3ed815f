"""Strings at the start: the particles that they hold, and their lengths."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene, String


def held_particle(number: int, string: String, scene: Scene, shapes: Sequence[BalloonShape]) -> int:
    """The particle that a string holds, numbered within its balloon.

    Raises:
        InputError: its balloon has no such particle.
    """
    mesh = shapes[string.balloon].mesh
    if isinstance(string.particle, str):
        used = np.unique(mesh.face_vertex_indices)
        heights = mesh.points[used] @ np.array(scene.up)
        return int(used[heights.argmax() if string.particle == "highest" else heights.argmin()])
    if string.particle >= mesh.vertex_count:
        raise InputError(
            f"string.{number}.particle: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {string.particle})"
        )
    return mesh.stand_in(string.particle)


def string_lengths(
    scene: Scene, shapes: Sequence[BalloonShape], held: Sequence[int], parameters: Parameters
) -> NDArray[np.float64]:
    """Where the scene says none, the distance [m] from anchor to particle at the start, shape (W, string_count)."""
    lengths = parameters["string_length"]
    if not np.isnan(lengths).any():
        return lengths
    balloons = [string.balloon for string in scene.string]
    starts = np.concatenate(
        [
            start_of(scene, parameters, balloon, shapes[balloon].mesh.points[[particle]])
            for balloon, particle in zip(balloons, held, strict=True)
        ],
        axis=1,
    )
    return np.where(np.isnan(lengths), np.linalg.norm(starts - parameters["string_anchor"], axis=-1), lengths)
