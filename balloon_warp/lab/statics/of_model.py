"""A simulated balloon as the host's statics have it: its skin, and how stiffly it holds its place."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.lab.statics.skins import FilmSkin, SpringSkin, Volume, determinant, metric_of
from balloon_warp.model.materials import law_of, numbers_of
from balloon_warp.model.model import Model
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

Values = NDArray[np.float64]


def springs_of(shape: BalloonShape, constants: Values) -> SpringSkin:
    """Return the springs of a balloon.

    Args:
        constants: of the three kinds [N/m].
    """
    springs = shape.springs
    return SpringSkin(
        springs.pairs.astype(np.int64), springs.rest_lengths, constants[springs.kind] * shape.stiffness_scale
    )


def film_of(scene: Scene, number: int, shape: BalloonShape, parameters: Any) -> FilmSkin:
    """Return the membrane of a balloon of rubber or film.

    Args:
        parameters: of one world, by name, each of shape (1, balloon_count, ...).
    """
    law, told = law_of(scene, number), numbers_of(parameters, number)
    assert law is not None
    membrane = shape.membrane
    parts = membrane.areas / (0.5 * np.sqrt(determinant(metric_of(membrane.edges))))  # of the whole thickness
    numbers = {name: values.reshape(3) if values.size == 3 else float(values.item()) for name, values in told.items()}
    skins = numbers["thickness"] * parts
    return FilmSkin(law, numbers, membrane.corners, skins, membrane.edges, wrinkles=numbers["wrinkling"] != 0.0)


class WholeSkin:
    """The springs and the film of a balloon together."""

    def __init__(self, skins: list[Any]):
        self._skins = skins

    def stiffness(self, points: Values) -> Any:
        """Return minus the derivatives of the forces [N/m], shape (3 n, 3 n)."""
        return sum(skin.stiffness(points) for skin in self._skins)


def stiffness_in(model: Model, frame: Frame, world: int, balloon: int) -> LinearOperator:
    """Return `stiffness_operator` of a balloon in a frame.

    Raises:
        InputError: there is no such balloon.
    """
    if not isinstance(balloon, int) or not 0 <= balloon < len(frame.points):
        raise InputError(f"balloon: no balloon {balloon}; expected 0 to {len(frame.points) - 1}")
    points = frame.points[balloon].astype(np.float64)
    return stiffness_operator(model, points, float(frame.pressures[balloon]), world, balloon)


def stiffness_operator(model: Model, points: Values, pressure: float, world: int, number: int) -> LinearOperator:
    """Return the stiffness operator of a balloon [N/m], shape (3 n, 3 n), symmetric.

    It is minus the derivative of the forces of springs, film, pressure and gas by the particles' positions. The gas's
    part is a product of two vectors, so that the matrix is not sparse.

    Args:
        points: Positions of the balloon's particles [m], shape (n, 3).
        pressure: Gauge pressure [Pa].
    """
    shape, scene = model.shapes[number], model.scene
    rows = {name: values.numpy() for name, values in model.parameters.items()}
    own = {name: values[world % len(values)][None] for name, values in rows.items()}
    constants = np.array([own[row.name][0, number] for row in KINDS], dtype=np.float64)
    skins: list[Any] = [springs_of(shape, constants)] if shape.springs.count else []
    if shape.membrane.count:
        skins.append(film_of(scene, number, shape, own))
    volume = Volume(shape.skin)
    matrix = WholeSkin(skins).stiffness(points)
    squeeze = 0.0
    if scene.balloon[number].inflation.kind != "normal_force":
        matrix = matrix - pressure * volume.curvature(points)
    if scene.balloon[number].inflation.kind == "gas":
        gamma = float(own["gamma"][0, number])
        squeeze = gamma * (float(own["air_pressure"][0]) + pressure) / volume.of(points)
    slopes = volume.slopes(points).ravel()

    def times(vector: Values) -> Values:
        return matrix @ vector.ravel() + slopes * (squeeze * (slopes @ vector.ravel()))

    return LinearOperator(matrix.shape, matvec=times, rmatvec=times, dtype=np.float64)  # pyright: ignore
