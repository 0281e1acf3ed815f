"""The pressure that a balloon gets where the scene leaves it open, "auto". Host side."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.mesh.corners import face_starts
from balloon_warp.mesh.geometry import face_areas, total_area, vertex_areas, vertex_normals
from balloon_warp.mesh.topology import mesh_edges, non_manifold_edges, vertex_components
from balloon_warp.model.foretold_volume import MOST_VERTICES, volume_under
from balloon_warp.model.materials import law_of, numbers_of, slopes_by_stretches
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.strung import mean_radius, pressure_of_stretch
from balloon_warp.scene import Balloon, Scene

MOST_OF_RUBBER = 4.0e3
"""Largest "auto" pressure of a membrane [Pa]"""
TAUT, WEIGHT_OF_MASS = 300.0, 9.81
"""Largest "auto" pressure of film, over its weight on its area where 1 kg weighs 9.81 N: 50 Pa for foil. By more, film
that hardly stretches only asks for a higher modulus, and so for more substeps, see `strain_bound`"""
MOST_SWELLING = 1.28
"""Largest volume over that of a ball of the same stretch, of surfaces with edges of more than two faces and thin parts
that nothing ties"""
GROWTH = 1.2
"""Power of the pressure to which the volume grows: from 1.1 to 1.3 of meshes that were looked at"""
ALIKE = 0.05
"""Difference of the factor from 1 below which a surface counts as a ball"""
HOLLOW, FLAT, ROUND = 1.6, 0.1, 0.9
"""Growth over a ball's that is expected of a mesh too large to foretell, and the bounds of its mean radius over that of
the sphere of its area between which it has hollows"""
LEAST_FACTOR, MOST_FACTOR, HALVINGS = 1.0e-3, 2.0, 7
"""Bounds of the factor on their pressure, and the number of bisections of its logarithm"""
UNEVEN = 1.4
"""Ratio of a surface's mean tension to its least up to which it counts as even"""


def settle_pressure(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> NDArray[np.float64]:
    """Return the pressures at keyframes [Pa], with "auto" ones computed, shape (W, balloon_count, keyframe_count).

    "auto" values are NaN until now.

    Scaled by s in all directions, springs of constant k and rest length L pull inward like a pressure p on a volume
    s^3 V: by virtual work 3 p V s^2 = sum k L^2 (s - 1). With the volume V = A R / 3 of a sphere, and the surface's
    tension K for each unit of strain, K = sum k L^2 / 2 A, that is p = 2 K (s - 1) / (s^2 R). Beyond s = 2, where p is
    largest, a balloon would swell without end. R is that of a sphere of the balloon's area, since no shape of that area
    can become larger; or, where springs across thin parts see to that, of its own volume and area, 3 V / A.

    A balloon of which nothing has an inside, and whose borders are free, gets none: it would shoot away.
    """
    values = parameters["keyframe_values"]
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        if balloon.inflation.is_automatic:
            if law := law_of(scene, number):
                told = numbers_of(parameters, number)
                pressures = np.zeros((1, 1))
                if not shape.flies_off:
                    stretches = np.array([1.0 + balloon.inflation.stretch])
                    most = _most_pressure(balloon, parameters, number)
                    pressures = np.minimum(pressures_of_membrane(shape, law, told, stretches), most)
                values = _with_settled(values, number, pressures)
                continue
            constants = np.stack(np.broadcast_arrays(*(parameters[row.name][:, number] for row in KINDS)), axis=-1)
            each = pressures_of_springs(shape) * pressure_of_stretch(balloon.inflation.stretch)
            pressures = np.zeros((1, 1)) if shape.flies_off else constants @ each[:, None]
            pressures = pressures * _factor(shape, constants[0], pressures[0, 0], balloon.inflation.stretch)
            values = _with_settled(values, number, pressures)
    return values


def _most_pressure(balloon: Balloon, parameters: Parameters, number: int) -> NDArray[np.float64]:
    """Return the largest "auto" pressure of a balloon of rubber or film [Pa], shape (W, 1)."""
    weights = WEIGHT_OF_MASS * parameters["initial_density"][:, [number]] * parameters["thickness"][:, [number]]
    is_film = balloon.material.value("strain_bound") is not None
    return np.minimum(MOST_OF_RUBBER, TAUT * weights if is_film else np.inf)


def _with_settled(values: NDArray[np.float64], number: int, pressures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values with a balloon's pressures, shape (W, 1), in place of "auto" ones."""
    rows = max(len(values), len(pressures))
    values = np.broadcast_to(values, (rows, *values.shape[1:])).copy()
    values[:, number] = np.where(np.isnan(values[:, number]), pressures, values[:, number])
    return values


def pressures_of_membrane(
    shape: BalloonShape, law: Law, told: Mapping[str, NDArray[np.float64]], stretches: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the pressures that stretch a spherical membrane of the same area [Pa], shape (W, stretch_count).

    2 h dW/dl / (l^2 R), by virtual work.
    """
    area = total_area(shape.mesh)
    radius = np.sqrt(area / ((4.0 if shape.closed else 2.0) * np.pi))
    thickness = told["thickness"] * shape.membrane.areas.sum() / area
    slope, _ = slopes_by_stretches(law, told, stretches, stretches)
    return 2.0 * thickness * slope / (stretches**2 * radius)


def with_settled_pressure(scene: Scene, parameters: Parameters) -> Scene:
    """Return the scene with the first world's values in place of "auto" pressures."""
    balloons = list(scene.balloon)
    for number, balloon in enumerate(balloons):
        if balloon.inflation.is_automatic:
            times = [time for time, _ in balloon.inflation.keyframes]
            values = parameters["keyframe_values"][0, number, : len(times)].tolist()
            inflation = balloon.inflation.model_copy(update={"pressure": list(zip(times, values, strict=True))})
            balloons[number] = balloon.model_copy(update={"inflation": inflation})
    return scene.model_copy(update={"balloon": balloons})


def pressures_of_springs(shape: BalloonShape) -> NDArray[np.float64]:
    """Return the pressure [Pa] for each N/m of the three kinds of springs, shape (3,), over (s - 1) / s^2: 2 K / R.

    The largest of several parts counts. Springs between parts, and across thin ones, hold no surface. A surface with a
    border may become half a sphere.
    """
    mesh, springs = shape.mesh, shape.springs
    parts = vertex_components(mesh, mesh_edges(mesh))
    areas = face_areas(mesh)
    if not areas.sum():
        return np.zeros(len(KINDS))
    largest = np.bincount(parts[mesh.face_vertex_indices[face_starts(mesh)]], areas).max()
    radius = np.sqrt(largest / ((4.0 if shape.closed else 2.0) * np.pi))
    within = parts[springs.pairs[:, 0]] == parts[springs.pairs[:, 1]]
    if shape.across is not None:
        within &= ~shape.across
        radius = mean_radius(mesh)
    weights = shape.stiffness_scale / shape.softness * springs.rest_lengths**2 * within
    tension = np.bincount(springs.kind, weights, len(KINDS)) / (2.0 * areas.sum())
    return 2.0 * _evenness(shape, within) * tension / radius


def _factor(shape: BalloonShape, constants: NDArray[np.float64], pressure: float, stretch: float) -> float:
    """Return the factor on a pressure by which a surface swells about as much as a ball.

    Folds, eyes and other hollows open before the skin stretches: under the pressure of a ball a face would swell by
    half, and be none any more. That is looked at where springs tie thin parts, as of a mesh by itself. Walls that meet
    along edges of more than two faces share vertices, so that nothing ties them: a cabinet of boards would swell six
    times. A shape without thickness, such as two sheets of foil, may swell as it will.

    Args:
        constants: of the kinds of springs [N/m], shape (3,).
        stretch: of a sphere's skin that is asked for.
    """
    walls, tied = len(non_manifold_edges(mesh_edges(shape.mesh))) > 0, shape.across is not None
    if not pressure or not shape.encloses or not (walls or tied):
        return 1.0
    most = (1.0 if tied else MOST_SWELLING) * (1.0 + stretch) ** 3
    swollen = volume_under(shape, constants, pressure)
    if swollen is None and tied and shape.mesh.vertex_count > MOST_VERTICES and _is_hollow(shape):
        swollen = 1.0 + HOLLOW * (most - 1.0)
    grown = (swollen or 1.0) - 1.0
    if grown > 0.0 and (tied if grown <= most - 1.0 else not walls):
        factor = ((most - 1.0) / grown) ** (1.0 / GROWTH)
        return min(factor, MOST_FACTOR) if abs(factor - 1.0) > ALIKE else 1.0
    if 0.0 < grown <= most - 1.0 or not walls:
        return 1.0
    low, high = LEAST_FACTOR, 1.0
    for _ in range(HALVINGS):
        middle = (low * high) ** 0.5
        swells = (volume_under(shape, constants, middle * pressure) or np.inf) > most
        low, high = (low, middle) if swells else (middle, high)
    return low


def _is_hollow(shape: BalloonShape) -> bool:
    """Return whether a surface is neither as round as a ball nor as flat as a sheet."""
    round_ = mean_radius(shape.mesh) / np.sqrt(total_area(shape.mesh) / (4.0 * np.pi))
    return FLAT < round_ < ROUND


def _evenness(shape: BalloonShape, within: NDArray[np.bool_]) -> float:
    """Return the stiffness against uniaxial relative to equibiaxial stretch, from 0 to 1.

    All but the softest tenth of the area exceed it: long thin faces, as of a cylinder without rings between its ends,
    have springs along them alone, and would burst. A ratio of up to `UNEVEN` counts as even, as for quads that somebody
    drew.

    A vertex has 1/2 k L^2 t t^T over its share of the area, summed over its springs of direction t; the least of that
    across the normal counts. By the defaults of the constants, so that it is a property of the mesh.

    Args:
        within: whether each spring is in the surface, and holds no parts or walls together.
    """
    mesh, springs = shape.mesh, shape.springs
    areas = vertex_areas(mesh)
    ways = mesh.points[springs.pairs[:, 1]] - mesh.points[springs.pairs[:, 0]]
    constants = np.array([row.default for row in KINDS])[springs.kind] * shape.evenness * within
    pulls = 0.5 * constants[:, None, None] * ways[:, :, None] * ways[:, None, :]
    tensors = np.zeros((mesh.vertex_count, 3, 3))
    for end in (0, 1):
        np.add.at(tensors, springs.pairs[:, end], pulls)
    normals = vertex_normals(mesh)
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    strengths = np.linalg.eigvalsh(across @ tensors @ across)[:, 1]  # the first is 0, along the normal
    used = areas > 0.0
    softest = np.argsort(strengths[used] / areas[used])
    tenth = np.searchsorted(np.cumsum(areas[used][softest]), 0.1 * areas.sum())
    least = (strengths[used] / areas[used])[softest][min(tenth, len(softest) - 1)]
    mean = np.trace(tensors, axis1=1, axis2=2).sum() / (2.0 * areas.sum())
    return float(min(UNEVEN * least / mean, 1.0))
