"""Initial placement and velocity of each balloon in each world. Host side, float64.

The scene places a balloon's mesh; a world may turn it about its origin, and shift it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import box_corners, require_reach
from balloon_warp.mesh.load import rotation_matrix
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

ALIKE = 1e-6
"""Difference of heights, over a balloon's size, below which either may count as the extreme one"""


def settle_starts(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Parameters:
    """Convert places and rotations to the transforms by which the device makes the start.

    Returns:
        `initial_shifts` [m] and `initial_centers`, of mass [m], of shape (W, balloon_count, 3), and `initial_turns`,
        shape (W, balloon_count, 3, 3): the matrix of the rotation from where the scene has the balloon, less 1. So it
        is exactly 0 where no world turns it.

    Raises:
        InputError: a balloon is too far away for float32, or turns where its springs' constants hang on how it stands.
    """
    placed = np.array([balloon.position for balloon in scene.balloon])
    settled = {
        "initial_shifts": parameters["initial_balloon_positions"] - placed,
        "initial_turns": _turns(scene, parameters["initial_rotations"]),
    }
    settled["initial_centers"] = np.stack(
        np.broadcast_arrays(
            *(
                start_of(scene, settled, number, (shape.mass_share @ shape.mesh.points)[None])[:, 0]
                for number, shape in enumerate(shapes)
            )
        ),
        axis=1,
    )
    for number, shape in enumerate(shapes):
        require_reach(shape.mesh, shape.name, start_of(scene, settled, number, box_corners(shape.mesh)))
        if scene.balloon[number].stiffness.gradient != (1.0, 1.0) and settled["initial_turns"][:, number].any():
            raise InputError(
                f"balloon.{number}.rotation: cannot differ between worlds while stiffness.gradient changes springs "
                "along an axis of the scene"
            )
    return settled


def start_of(scene: Scene, parameters: Parameters, number: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a balloon, where the scene has them, as they are at the start of each world.

    Args:
        parameters: with those that `settle_starts` makes.
        points: [m], shape (n, 3).

    Returns:
        [m], shape (W, n, 3).
    """
    arms = points - np.array(scene.balloon[number].position)
    turned = np.einsum("wij,nj->wni", parameters["initial_turns"][:, number], arms)
    return points + turned + parameters["initial_shifts"][:, number, None]


def start_velocities(shapes: Sequence[BalloonShape], parameters: Parameters) -> list[NDArray[np.float64]] | None:
    """Return bounds on the initial velocities of each balloon's particles [m/s], shape (particle_count, 3).

    They are those of the fastest world; None where all are at rest.
    """
    names = ("initial_velocities", "initial_spins")
    if not any(parameters[name].any() for name in names):
        return None
    fastest = []
    for number, shape in enumerate(shapes):
        velocity, spin = (np.linalg.norm(parameters[name][:, number], axis=-1).max() for name in names)
        reach = np.linalg.norm(shape.mesh.points - shape.mass_share @ shape.mesh.points, axis=1)
        along = np.zeros((len(reach), 3))
        along[:, 0] = velocity + spin * reach
        fastest.append(along)
    return fastest


def require_same_extreme(scene: Scene, parameters: Parameters, string: int, shape: BalloonShape, held: int) -> None:
    """Make sure that the particle which a string holds because it is the highest or lowest is that in every world.

    Raises:
        InputError: names a world where it is not.
    """
    tied = scene.string[string]
    turns = parameters["initial_turns"][:, tied.balloon]
    if not isinstance(tied.particle, str) or not turns.any():
        return
    sign = 1.0 if tied.particle == "highest" else -1.0
    used = shape.mesh.points[np.unique(shape.mesh.face_vertex_indices)] - shape.mesh.points[held]
    slack = ALIKE * float(np.ptp(used, axis=0).max())
    for world, turn in enumerate(turns):
        if (used @ ((turn + np.eye(3)).T @ np.array(scene.up)) * sign).max() > slack:
            raise InputError(
                f"balloon.{tied.balloon}.rotation: in world {world} string {string} would hold another particle, which "
                f"is the {tied.particle} there; expected string.{string}.particle as a number, {held} for the scene's "
                "own"
            )


def _turns(scene: Scene, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """See `settle_starts`; rotations about x, y and z [degrees], shape (W, balloon_count, 3)."""
    turns = np.zeros((*rotations.shape[:2], 3, 3))
    for number, balloon in enumerate(scene.balloon):
        own = rotation_matrix(balloon.rotation)
        for world in np.flatnonzero((rotations[:, number] != balloon.rotation).any(axis=1)).tolist():
            turns[world, number] = rotation_matrix(rotations[world, number]) @ own.T - np.eye(3)
    return turns
