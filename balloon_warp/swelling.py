"""Prediction of the volume of balloons with an "auto" pressure, before simulation, on the host in float64."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.mesh.corners import corner_faces
from balloon_warp.mesh.geometry import face_vector_areas, signed_volume
from balloon_warp.model import Model, plan_model
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene
from balloon_warp.warp_lock import lock_of

MOST_VERTICES = 12_000
"""Largest number of vertices of a balloon whose volume is predicted: with more, it would take longer than to begin"""
ROUNDS = 60
KEPT = 6
"""Number of iterations that the next one is extrapolated from"""
CLOSE = 2.0e-3
"""Change of the volume in `CALM` iterations at convergence, over the volume at the start"""
CALM = 4
ANCHOR = 1.0e-4
"""Regularization that makes the springs' Laplacian invertible, over its mean diagonal"""


@dataclass(frozen=True)
class Swelling:
    """Result of an "auto" pressure."""

    balloon: str
    pressure: float
    """Pressure [Pa]"""
    volume: float | None
    """Volume in equilibrium with the springs, without weight, over that at the start; None where it is not predicted:
    for open balloons, rubber and film, and large meshes"""

    def __str__(self) -> str:
        volume = "" if self.volume is None else f", volume 1.00 -> {self.volume:.2f}"
        return f"auto pressure {self.pressure:.4g} Pa{volume}"


def swellings(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[Swelling]:
    """Return the swelling of each balloon with a nonzero "auto" pressure, in the first world."""
    found = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        pressure = float(parameters["keyframe_values"][0, number, -1]) if balloon.inflation.is_automatic else 0.0
        if pressure:
            foretold = shape.closed and not shape.membrane.count and shape.mesh.vertex_count <= MOST_VERTICES
            constants = np.array([parameters[row.name][0, number] for row in KINDS])
            volume = volume_under(shape, constants, pressure) if foretold else None
            found.append(Swelling(shape.name, pressure, volume))
    return found


def swellings_of(model: Model) -> list[Swelling]:
    """Foretell the swellings of a model."""
    names = ("keyframe_values", *(row.name for row in KINDS))
    with lock_of(model.device):
        read = {name: np.asarray(model.parameters[name].numpy(), dtype=np.float64) for name in names}
    return swellings(model.scene, model.shapes, read)


def foretold_swellings(scene: Scene) -> list[Swelling]:
    """Foretell the swellings of a scene.

    Raises:
        InputError: as `plan_model`.
    """
    plan = plan_model(scene)
    return swellings(plan.scene, plan.shapes, plan.parameters)


def sentences(found: Sequence[Swelling]) -> list[str]:
    """Return sentences on the swelling of balloons, with the balloon's name where there are several."""
    return [f"{each.balloon}: {each}" if len(found) > 1 else str(each) for each in found]


def told_before(
    found: Sequence[Swelling], on_note: Callable[[str], None], on_frame: Callable[[int], None]
) -> Callable[[int], None]:
    """Make a listener to frames that notes these before the first.

    Where no frame comes, something is wrong, and there is nothing to say but that.
    """
    waiting = sentences(found)

    def listen(number: int) -> None:
        while waiting:
            on_note(waiting.pop(0))
        on_frame(number)

    return listen


def volume_under(shape: BalloonShape, constants: NDArray[np.float64], pressure: float) -> float | None:
    """Find the volume in balance, over that at the start; None where there is none.

    Each round solves for the places at which the springs, each at its rest length along the way that it has now, and
    the pressure's forces of now are in balance: as projective dynamics does (Bouaziz et al. 2014), with a step without
    end. Rounds are extrapolated from those before (Anderson 1965).

    Args:
        constants: of the kinds of springs [N/m], shape (3,).
        pressure: [Pa].
    """
    points, start = shape.mesh.points, signed_volume(shape.mesh)
    if not start:
        return None
    round_of = _rounds(shape, constants[shape.springs.kind] * shape.stiffness_scale, pressure)
    volumes: list[float] = []
    places: list[NDArray[np.float64]] = []
    moves: list[NDArray[np.float64]] = []
    for _ in range(ROUNDS):
        places, moves = [*places[-KEPT:], points.ravel()], [*moves[-KEPT:], round_of(points).ravel()]
        points = _extrapolated(places, moves).reshape(-1, 3)
        volumes.append(signed_volume(replace(shape.mesh, points=points)) / start)
        if not np.isfinite(volumes[-1]):
            return None
        if len(volumes) > CALM and np.ptp(volumes[-CALM:]) < CLOSE:
            return volumes[-1]
    return None


def _rounds(shape: BalloonShape, constants: NDArray[np.float64], pressure: float) -> Any:
    """Make the function that gives how far each particle moves in a round, from the points of all [m]."""
    from scipy.sparse import coo_array, csc_matrix, diags_array
    from scipy.sparse.linalg import splu

    springs, mesh, count = shape.springs, shape.mesh, shape.mesh.vertex_count
    rows, signs = np.arange(springs.count), np.ones(springs.count)
    ends = np.concatenate([springs.pairs[:, 0], springs.pairs[:, 1]])
    entries = np.concatenate([-signs, signs]), (np.concatenate([rows, rows]), ends)
    differences = coo_array(entries, shape=(springs.count, count)).tocsr()
    back = differences.T.tocsr()
    laplacian = back @ diags_array(constants) @ differences
    held = ANCHOR * laplacian.diagonal().mean() or 1.0
    free = shape.mass_share > 0.0
    solver = splu(
        csc_matrix(laplacian + diags_array(np.where(free, held, 1e9 * held / ANCHOR))),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )

    def moves(points: NDArray[np.float64]) -> NDArray[np.float64]:
        ways = differences @ points
        lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-30)
        pulls = back @ ((constants * (1.0 - springs.rest_lengths / lengths))[:, None] * ways)
        shares = pressure * face_vector_areas(replace(mesh, points=points)) / mesh.face_vertex_counts[:, None]
        pushes = [np.bincount(mesh.face_vertex_indices, each[corner_faces(mesh)], count) for each in shares.T]
        return solver.solve(np.where(free[:, None], np.stack(pushes, axis=1) - pulls, 0.0))

    return moves


def _extrapolated(places: list[NDArray[np.float64]], moves: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Extrapolate iterations to the place where their moves vanish; with one, return the last place, moved."""
    if len(moves) == 1:
        return places[0] + moves[0]
    between = np.diff(np.array(moves), axis=0)
    products = between @ between.T
    products += 1e-12 * np.trace(products) * np.eye(len(products))
    parts = np.linalg.lstsq(products, between @ moves[-1], rcond=None)[0]
    return places[-1] + moves[-1] - parts @ (np.diff(np.array(places), axis=0) + between)
