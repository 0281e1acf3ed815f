"""Pressures of balloons on the host: "auto", predicted volumes, limit points, and a liquid's gradient.

Gas as the host settles it: at the start, from the scene's amounts and pressures, and where its gamma changes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.air import ALIKE, GAS_CONSTANT, HIGHEST, density_of_given_air
from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE
from balloon_warp.kernels.laws.outer import EVENED
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.mesh.load import open_seam, welded
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    border_edges,
    face_areas,
    face_starts,
    inconsistent_edges,
    is_closed,
    mesh_edges,
    non_manifold_edges,
    signed_volume,
    total_area,
    vertex_areas,
    vertex_components,
    vertex_normals,
    vertex_vector_areas,
)
from balloon_warp.model.materials import law_of, numbers_of, slopes_by_stretches
from balloon_warp.model.model import Model
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape, mean_radius, pressure_of_stretch
from balloon_warp.model.spectrum import ALL
from balloon_warp.model.state import State
from balloon_warp.scene import Balloon, Scene

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


def volume_under(shape: BalloonShape, constants: NDArray[np.float64], pressure: float) -> float | None:
    """Find the volume within the faces that are pushed, in balance, over that at the start.

    None where there is none, or where it would take long.

    Each round solves for the places at which the springs, each at its rest length along the way that it has now, and
    the pressure's forces of now are in balance: as projective dynamics does (Bouaziz et al. 2014), with a step without
    end. Rounds are extrapolated from those before (Anderson 1965).

    Args:
        constants: of the kinds of springs [N/m], shape (3,).
        pressure: [Pa].
    """
    points, start = shape.mesh.points, signed_volume(shape.skin)
    if not start or not shape.encloses or len(points) > MOST_VERTICES:
        return None
    round_of = _rounds(shape, constants[shape.springs.kind] * shape.stiffness_scale, pressure)
    volumes: list[float] = []
    places: list[NDArray[np.float64]] = []
    moves: list[NDArray[np.float64]] = []
    for _ in range(ROUNDS):
        places, moves = [*places[-KEPT:], points.ravel()], [*moves[-KEPT:], round_of(points).ravel()]
        points = _extrapolated(places, moves).reshape(-1, 3)
        volumes.append(signed_volume(replace(shape.skin, points=points)) / start)
        if not np.isfinite(volumes[-1]):
            return None
        if len(volumes) > CALM and np.ptp(volumes[-CALM:]) < CLOSE:
            return volumes[-1]
    return None


def _rounds(shape: BalloonShape, constants: NDArray[np.float64], pressure: float) -> Any:
    """Make the function that gives how far each particle moves in a round, from the points of all [m]."""
    from scipy.sparse import coo_array, csc_matrix, diags_array
    from scipy.sparse.linalg import splu

    springs, mesh, count = shape.springs, shape.skin, shape.mesh.vertex_count
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
        pushes = pressure * vertex_vector_areas(replace(mesh, points=points))
        return solver.solve(np.where(free[:, None], pushes - pulls, 0.0))

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
ALIKE_PRESSURES = 0.05
"""Difference of the factor from 1 below which a surface counts as a ball"""
HOLLOW, FLAT, ROUND = 1.6, 0.1, 0.9
"""Growth over a ball's that is expected of a mesh too large to foretell, and the bounds of its mean radius over that of
the sphere of its area between which it has hollows"""
LEAST_FACTOR, MOST_FACTOR, HALVINGS = 1.0e-3, 2.0, 7
"""Bounds of the factor on their pressure, and the number of bisections of its logarithm"""
UNEVEN = 1.4
"""Ratio of a surface's mean tension to its least up to which it counts as even"""


def resolve_pressure(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> NDArray[np.float64]:
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
                    most = _max_pressure(balloon, parameters, number)
                    pressures = np.minimum(pressures_of_membrane(shape, law, told, stretches), most)
                values = _with_resolved(values, number, pressures)
                continue
            constants = np.stack(np.broadcast_arrays(*(parameters[row.name][:, number] for row in KINDS)), axis=-1)
            each = pressures_of_springs(shape) * pressure_of_stretch(balloon.inflation.stretch)
            pressures = np.zeros((1, 1)) if shape.flies_off else constants @ each[:, None]
            pressures = pressures * _factor(shape, constants[0], pressures[0, 0], balloon.inflation.stretch)
            values = _with_resolved(values, number, pressures)
    return values


def _max_pressure(balloon: Balloon, parameters: Parameters, number: int) -> NDArray[np.float64]:
    """Return the largest "auto" pressure of a balloon of rubber or film [Pa], shape (W, 1)."""
    weights = WEIGHT_OF_MASS * parameters["initial_density"][:, [number]] * parameters["thickness"][:, [number]]
    is_film = balloon.material.value("strain_bound") is not None
    return np.minimum(MOST_OF_RUBBER, TAUT * weights if is_film else np.inf)


def _with_resolved(values: NDArray[np.float64], number: int, pressures: NDArray[np.float64]) -> NDArray[np.float64]:
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


def with_resolved_pressure(scene: Scene, parameters: Parameters) -> Scene:
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
        return min(factor, MOST_FACTOR) if abs(factor - 1.0) > ALIKE_PRESSURES else 1.0
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


Values = NDArray[np.float64]
BEARS = 0.4
"""Pressure of a liquid over the radius that a skin bears, over how fast its own rises with stretch: balls keep their
shape up to 0.37, and turn inside out from 0.75 on"""
BEARING_TAUT, SLACK = 0.97, 0.94
"""Stretch at the start below which a skin bears less, and that below which it hangs slack"""
PUSHED = 0.15
"""Part that springs bear of it then, which push where they are short; rubber and film do not"""
LEAST = 1.0e-3
"""Part of a skin that bears all while it is taut and not once it hangs slack, as where a balloon sinks"""
WIDEST, VACUUM = 10.0, 1.0
"""Largest stretch that is looked at, and least pressure around [Pa]"""
BEARING_CLOSE = 1.0e-3
"""Difference of stretches by which slopes are taken"""


def resolve_bearing(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Values:
    """Return the part of a liquid's pressure that acts evenly on each balloon, shape (W, balloon_count).

    What a skin bears is in proportion to how fast its own pressure rises with stretch, as of a sphere, where its gas is
    at the air's pressure. Skin that hangs slack, because it is large for its gas or pressed small at the start, bears
    little or nothing. The part is 0 without gas, and without a liquid.
    """
    said = parameters[EVENED.name]
    parts = [np.zeros(len(said))] * len(shapes)
    for number, shape in enumerate(shapes):
        if scene.water is not None and scene.balloon[number].inflation.kind == "gas":
            own = said[:, number]
            parts[number] = np.where(own < 0.0, _not_borne(scene, number, shape, parameters), own)
    return np.stack(np.broadcast_arrays(*parts), axis=1)


def _not_borne(scene: Scene, number: int, shape: BalloonShape, parameters: Parameters) -> Values:
    """Return the part of a liquid's pressure that a skin does not bear where it is, shape (W,)."""
    names = ("water_density", "gravity", "water_level", "air_pressure")
    density, gravity, level, air = (parameters[name] for name in names)
    depth = np.maximum(level - parameters["initial_centers"][:, number] @ np.array(scene.up), 0.0)
    free_volume, gamma = (parameters[name][:, number] for name in ("initial_free_volumes", "gamma"))
    room = max(signed_volume(shape.mesh), 1.0e-30)
    out, here = (
        np.cbrt(free_volume * (STANDARD_PRESSURE / np.maximum(pressure, VACUUM)) ** (1.0 / gamma) / room)
        for pressure in (air, air + density * gravity * depth)
    )
    stretch = np.clip(out, 1.0, WIDEST)
    rise = (_pressure(scene, number, shape, parameters, stretch + BEARING_CLOSE)
            - _pressure(scene, number, shape, parameters, stretch)) / BEARING_CLOSE  # fmt: skip
    head = density * np.abs(gravity) * stretch * np.sqrt(shape.area / (4.0 * np.pi))
    borne = BEARS * np.nan_to_num(rise) / np.maximum(head, 1.0e-30)
    pushed = 0.0 if law_of(scene, number) else PUSHED
    taut = np.clip((here - SLACK) / (BEARING_TAUT - SLACK), pushed, 1.0)
    return np.clip(1.0 - borne * taut, np.where(borne * pushed < 1.0, LEAST, 0.0), 1.0)


def _pressure(scene: Scene, number: int, shape: BalloonShape, parameters: Parameters, stretch: Values) -> Values:
    """Return the pressure that stretches a sphere of the balloon's area so far [Pa], shape (W,)."""
    if law := law_of(scene, number):
        return pressures_of_membrane(shape, law, numbers_of(parameters, number), stretch[:, None])[:, 0]
    constants = np.stack(np.broadcast_arrays(*(parameters[row.name][:, number] for row in KINDS)), axis=-1)
    return constants @ pressures_of_springs(shape) * (stretch - 1.0) / stretch**2


SOFTEST_SPRINGS = 8.0
"""Largest stretch of springs in the search for the limit point, whose pressure peaks at 2"""
STATES = 2000
LIMIT_CLOSE = 0.98
"""Margin on the limit pressure, since a mesh's differs from that of a sphere"""


@dataclass(frozen=True)
class LimitPoint:
    """Limit point of a balloon, the first peak of its pressure over stretch, and the pressure that it is given."""

    material: str
    stretch: float
    """Equibiaxial stretch at the limit point"""
    most: float
    """Pressure at the limit point [Pa]"""
    given: float
    """Pressure that the balloon is given [Pa]"""

    held_again: float | None = None
    """Larger stretch at which the given pressure is in equilibrium, if there is one"""

    def __str__(self) -> str:
        again = self.held_again
        beyond = f"at once, to a stretch of {again:.3g}" if again else "without end"
        return (
            f"its pressure of {self.given:.4g} Pa exceeds the {self.most:.4g} Pa that {self.material} of its area "
            f"bears at the limit point, a stretch of {self.stretch:.3g}; beyond, it swells {beyond}: less pressure "
            'helps, or a gas (inflation.kind = "gas"), whose pressure falls as it swells'
        )


def borne_pressures(
    scene: Scene, number: int, shape: BalloonShape, parameters: Parameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stretches, and the pressures of a sphere of the balloon's area at these [Pa], in its first world."""
    first = {name: values[:1] for name, values in parameters.items()}
    if law := law_of(scene, number):
        told = numbers_of(first, number)
        stretches = np.linspace(1.0, max(float(told["most_stretch"].item()), 1.01), STATES)
        return stretches, pressures_of_membrane(shape, law, told, stretches)[0]
    stretches = np.linspace(1.0, SOFTEST_SPRINGS, STATES)
    constants = np.array([first[row.name][0, number] for row in KINDS])
    return stretches, float(constants @ pressures_of_springs(shape)) * (stretches - 1.0) / stretches**2


def passed_limit_point(
    scene: Scene,
    number: int,
    shape: BalloonShape,
    parameters: Parameters,
    given: float,
    points: NDArray[np.float64] | None = None,
) -> LimitPoint | None:
    """Return the limit point that a balloon under a given pressure has passed.

    None if it has not, or its gas is controlled by volume.

    Args:
        parameters: of one world.
        given: its pressure [Pa].
        points: where its particles are [m], shape (particle_count, 3); without them it has passed if it bears that
            pressure at no stretch.
    """
    if scene.balloon[number].inflation.kind != "pressure" or not np.isfinite(given) or given <= 0.0:
        return None
    stretches, pressures = borne_pressures(scene, number, shape, parameters)
    if pressures.max() <= 0.0:
        return None
    falls = np.flatnonzero(np.diff(pressures) < 0.0)
    if not len(falls):
        return None
    peak = int(falls[0])
    past = given > pressures.max() / LIMIT_CLOSE
    if points is not None:
        past = given > LIMIT_CLOSE * pressures[peak]
        area = total_area(replace(shape.mesh, points=points))
        stretch = np.sqrt(area / total_area(shape.mesh))
        past = past or bool(stretch > stretches[peak] and given > np.interp(stretch, stretches, pressures))
    if not past:
        return None
    law = scene.balloon[number].material.law
    ball = "a ball of springs" if law_of(scene, number) is None else f"a ball of {law.replace('_', '-')} rubber"
    again = np.flatnonzero(pressures[peak:] > given)
    held_again = float(stretches[peak + again[0]]) if len(again) and given > pressures[peak] else None
    return LimitPoint(ball, float(stretches[peak]), float(pressures[peak]), given, held_again)


def pressures_too_high(scene: Scene, shapes: list[BalloonShape], parameters: Parameters) -> list[str]:
    """Return a sentence for each balloon of rubber under a pressure that it bears at no stretch, in any world."""
    sentences = []
    values = parameters["keyframe_values"]
    for number, shape in enumerate(shapes):
        if law_of(scene, number) and scene.balloon[number].inflation.kind == "pressure":
            given = float(np.nanmax(values[:, number]))
            if limit := passed_limit_point(scene, number, shape, parameters, given):
                sentences.append(f"{shape.name}: {limit}")
    return sentences


LARGEST_OPENING = 0.25
"""Largest area of openings over a balloon's area at the start"""
LEAST_ROUNDNESS = 1.0e-6
"""Least volume over the cube of the size, for a balloon that can hold gas"""


def require_sealed(shape: BalloonShape) -> None:
    """Make sure that a balloon can hold gas.

    Raises:
        InputError: its mesh is open, has no inside, or encloses no volume.
    """
    edges = mesh_edges(shape.mesh)
    if not is_closed(edges):
        low, high = edges.ends[border_edges(edges)[0]] + 1
        helps = f"{weld}, which closes it," if (weld := _closing_weld(shape.mesh)) else "a closed mesh"
        raise InputError(
            f"{shape.name}: an open mesh cannot hold gas; the first open edge goes from vertex {low} to {high}, "
            f"counting from 1; expected {helps} or another inflation.kind"
        )
    if len(inconsistent_edges(edges)):
        low, high = edges.ends[inconsistent_edges(edges)[0]] + 1
        raise InputError(
            f"{shape.name}: a surface that is not orientable cannot hold gas; the first edge of opposite winding goes "
            f"from vertex {low} to {high}, counting from 1"
        )
    size = float(np.ptp(shape.mesh.points[shape.mesh.face_vertex_indices], axis=0).max())
    if signed_volume(shape.mesh) < LEAST_ROUNDNESS * size**3:
        raise InputError(f"{shape.name}: encloses no volume at the start and cannot hold gas")


def _closing_weld(mesh: PolygonMesh) -> str | None:
    """Return the option that closes an open mesh, if one does."""
    if is_closed(mesh_edges(welded(mesh))):
        return "--weld"
    seam = open_seam(mesh)
    return f"--weld {seam.weld}" if seam and seam.closes else None


def require_openings(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> None:
    """Make sure that gas can leave through necks and leaks.

    Raises:
        InputError: one is too wide for its balloon, or the gas weighs nothing.
    """
    for number, shape in enumerate(shapes):
        diameter = float(parameters["neck_diameter"][:, number].max())
        leak = float(parameters["leak"][:, number].max())
        widest = np.sqrt(LARGEST_OPENING * shape.area * 4.0 / np.pi)
        if diameter > widest:
            raise InputError(
                f"balloon.{number}.neck.diameter: must be at most {widest:.3g} m, for {shape.name} has "
                f"{shape.area:.3g} m^2 (got {diameter:g})"
            )
        if leak > LARGEST_OPENING * shape.area:
            raise InputError(
                f"balloon.{number}.inflation.leak: must be at most {LARGEST_OPENING * shape.area:.3g} m^2, for "
                f"{shape.name} has {shape.area:.3g} m^2 (got {leak:g})"
            )
        if (diameter > 0.0 or leak > 0.0) and float(parameters["molar_mass"][:, number].min()) <= 0.0:
            raise InputError(
                f"balloon.{number}.inflation.molar_mass: must be above 0 where gas leaves, since the flow depends on "
                "its density (got 0)"
            )


def resolve_gas(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, rounded: bool = True
) -> Parameters:
    """Return the initial amounts and free volumes of gas, and all initial pressures and loads.

    It is as warm as the air then, so that n moles in the volume V have p = n R T / V, and the free volume
    V (p / p_0)^(1 / gamma), see `kernels.laws.gas`.

    Args:
        rounded: whether to round as devices do; unrounded values can be derived.
    """
    heights = parameters["initial_centers"] @ np.array(scene.up)
    p_a, temperature, air = _air_around(parameters, heights)
    given, gamma = parameters["initial_gas_amounts"], parameters["gamma"]
    volume = np.array([max(signed_volume(shape.mesh), 1.0e-30) for shape in shapes])
    holds_gas = np.array([balloon.inflation.kind == "gas" for balloon in scene.balloon])
    pressed = np.array([balloon.inflation.kind == "pressure" for balloon in scene.balloon])
    asked = np.maximum(p_a + parameters["initial_pressures"], 0.0) * volume / (GAS_CONSTANT * temperature)
    amounts = np.where(np.isnan(given), asked, given) * holds_gas
    inside = amounts * GAS_CONSTANT * temperature / volume
    pressures = (inside - p_a) * holds_gas + parameters["keyframe_values"][:, :, 0] * pressed

    gas_density = amounts * parameters["molar_mass"] / volume
    rise = (air - gas_density) * parameters["gravity"][:, None] * holds_gas
    loads = np.broadcast_arrays(pressures - rise * heights, rise)
    free_volumes = volume * (inside / STANDARD_PRESSURE) ** (1.0 / gamma)
    # rounded as by kernels that pump, so that gas that is pumped later is until then as without a pump
    number = np.float32 if rounded else np.float64
    molar = number(GAS_CONSTANT) * parameters["air_temperature"].astype(number) / number(STANDARD_PRESSURE)
    as_warm = amounts * molar.astype(np.float64)[:, None]
    return {
        "initial_gas_amounts": amounts,
        "initial_free_volumes": np.where(gamma == 1.0, as_warm, free_volumes),
        "initial_pressures": pressures,
        "initial_loads": np.stack(loads, axis=-1),
    }


def _air_around(
    parameters: Parameters, heights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return pressure [Pa], temperature [K] and density [kg/m^3] of the air at each balloon, shape (W, B).

    As in `kernels.laws.air.air_of_height`.
    """
    names = ("air_pressure", "air_temperature", "air_density", "air_lapse", "gravity")
    pressure, temperature, given, lapse, gravity = (parameters[name][:, None] for name in names)
    density = density_of_given_air(pressure, temperature, given)
    falls = lapse > ALIKE
    colder = np.minimum(np.where(falls, lapse, 0.0) * heights / temperature, HIGHEST)
    little = np.abs(colder) < 1.0e-6
    more = np.where(little, 1.0 + 0.5 * colder, -np.log1p(-colder) / np.where(little, 1.0, colder))
    ratio = np.exp(-density * np.where(falls, gravity, 0.0) * heights * more / pressure)
    return pressure * ratio, temperature * (1.0 - colder), density * ratio / (1.0 - colder)


def pressure_bounds(scene: Scene, shapes: Sequence[BalloonShape]) -> list[float]:
    """Return each balloon's largest pressure of gas, over its mass and times the step squared [1/m].

    There is no bound where no gas is sealed, where the solver is stable at any step, and in water, whose pressure on
    the skin is above the air's, too.
    """
    unbounded = scene.solver == "projective" or scene.water is not None
    kinds = [balloon.inflation.kind for balloon in scene.balloon]
    return [
        shape.pressure_bound if kind == "gas" and not unbounded else ALL
        for kind, shape in zip(kinds, shapes, strict=True)
    ]


def keep_pressures(model: Model, state: State, parameters: Mapping[str, ArrayLike]) -> None:
    """Keep pressure p and volume of gas whose gamma is about to change.

    Its free volume becomes V_0 (p / p_0)^(1 / gamma - 1 / gamma_before).

    Args:
        parameters: those that change, by their names in `Model.parameters`.
    """
    if "gamma" in parameters:
        now = {name: array.numpy().astype(np.float64) for name, array in model.parameters.items()}
        loads = state.inflation_loads.numpy().astype(np.float64)
        above = state.pressures.numpy() - loads[..., 0]
        heights = np.divide(above, loads[..., 1], out=np.zeros_like(above), where=loads[..., 1] != 0.0)
        outside, temperature, _ = _air_around(now, heights)
        inside, warmth = outside + state.pressures.numpy(), temperature / now["air_temperature"][:, None]
        before, after = now["gamma"], np.asarray(parameters["gamma"])
        more = np.maximum(inside / STANDARD_PRESSURE, 1e-30) ** (1.0 / after - 1.0 / before)
        more = more * np.where(before == 1.0, warmth, 1.0) / np.where(after == 1.0, warmth, 1.0)
        state.free_volumes.assign(state.free_volumes.numpy() * more)
