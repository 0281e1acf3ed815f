"""Strings at the start: the particles that they hold, and their lengths."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.anchors import Carriers
from balloon_warp.model.bodies import BodyShape, initial_poses
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene, String

LEAST_STRETCH = 0.005
"""Initial strain of a string that is worth a warning: half a percent"""


def held_particle(number: int, string: String, scene: Scene, shapes: Sequence[BalloonShape]) -> int:
    """Return the particle that a string holds, numbered within its balloon.

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
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    parameters: Parameters,
) -> NDArray[np.float64]:
    """Return the strings' lengths [m], shape (W, string_count).

    The default is the initial distance from anchor to particle.
    """
    lengths = parameters["string_length"]
    if not np.isnan(lengths).any():
        return lengths
    return np.where(np.isnan(lengths), _spans(scene, shapes, bodies, held, parameters), lengths)


def overstretched_strings(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    parameters: Parameters,
) -> list[str]:
    """Return a sentence for each string that exists from the start and is then longer than its length.

    It is on the world where that is worst.
    """
    if not scene.string:
        return []
    spans = _spans(scene, shapes, bodies, held, parameters)
    spans, lengths = np.broadcast_arrays(spans, parameters["string_length"])
    stretches = spans / lengths - 1.0
    sentences = []
    for number in np.flatnonzero(stretches.max(axis=0) > LEAST_STRETCH).tolist():
        world = int(stretches[:, number].argmax())
        where = f" in world {world}" if len(stretches) > 1 else ""
        if scene.string[number].start == 0.0:
            sentences.append(
                f"string {number} starts overstretched by {stretches[world, number]:.0%}{where}: it is "
                f"{lengths[world, number]:.4g} m long, and its ends are {spans[world, number]:.4g} m apart"
            )
    return sentences


ANCHORED = ("string_anchor", "obstacle_position", "initial_body_positions")
"""Names of the parameters that anchors follow from"""


def _spans(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    parameters: Parameters,
) -> NDArray[np.float64]:
    """Return the vector from each string's anchor to its particle at the start [m], shape (W, string_count)."""
    balloons = [string.balloon for string in scene.string]
    starts = np.concatenate(
        [
            start_of(scene, parameters, balloon, shapes[balloon].mesh.points[[particle]])
            for balloon, particle in zip(balloons, held, strict=True)
        ],
        axis=1,
    )
    return np.linalg.norm(starts - anchors_of(scene, bodies, parameters), axis=-1)


def anchors_of(
    scene: Scene,
    bodies: Sequence[BodyShape],
    parameters: Mapping[str, Any],
    frame: float = 0,
    poses: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """Return the anchors of strings at a frame in each world [m], shape (W, string_count, 3).

    Args:
        poses: of bodies then, shape (W, body_count, 7); those of the start, when missing.
    """
    anchors, positions, starts = (np.asarray(parameters[name]) for name in ANCHORED)
    if poses is None:
        poses = initial_poses(scene, bodies, starts)
    return Carriers.of(scene, bodies).anchors_at(anchors, positions, poses, frame)
