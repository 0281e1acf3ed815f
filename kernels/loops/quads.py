"""Quads of membranes: tensions along edges and diagonals, in registers or eight side by side.

They follow from the sums of a quad's four triangles at rest. For laws that are `Law.linear` the constant parts of a
taut quad are computed once.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.algebra import dot_product, times
from balloon_warp.kernels.compose import choice_of_laws, numbers_reader
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes4, any_negative, entry_at, of_lane
from balloon_warp.kernels.laws.membrane import NEVER_ZERO, how_surely_taut, products_at_angles
from balloon_warp.kernels.loops.areas import crosses_at_quad_corners
from balloon_warp.kernels.loops.membranes import (
    MembraneFaceLayout,
    membrane_face_places,
    membrane_faces_of,
    pulls_between_corners,
    pulls_on_corners,
    taut_tension_function,
    tension_function,
    wear_of_triangle,
)
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.springs import Slots, slot_loop, spring_loop, springs_reader
from balloon_warp.kernels.memory import four_floats_at, four_ints_at, in_tile
from balloon_warp.kernels.tables import Tables

PART = wp.constant(0.5)
"""Fraction of the thickness that each of a quad's four triangles has"""


@wp.struct
class Metrics:
    """Products of the two edges that begin at each corner of a quad, see `products_between`."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    d: wp.vec3


@wp.func
def products_between(ab: wp.vec3, bc: wp.vec3, cd: wp.vec3, da: wp.vec3):
    """Return the dot products of a quad's edges [m^2].

    At each corner: of the triangle's first edge with itself, with its second, and of the second with itself.
    """
    squares = wp.vec4(wp.dot(ab, ab), wp.dot(bc, bc), wp.dot(cd, cd), wp.dot(da, da))
    metrics = Metrics()
    metrics.a = wp.vec3(squares[0], -1.0 * wp.dot(ab, da), squares[3])
    metrics.b = wp.vec3(squares[1], -1.0 * wp.dot(bc, ab), squares[0])
    metrics.c = wp.vec3(squares[2], -1.0 * wp.dot(cd, bc), squares[1])
    metrics.d = wp.vec3(squares[3], -1.0 * wp.dot(da, cd), squares[2])
    return metrics


@wp.struct
class Sums:
    """Rest sums of a quad, with the k that its tensions are proportional to [N/m]."""

    along: wp.vec4
    """Sum of the opposite cotangents of each edge, times k"""
    across: wp.vec2
    """Sum of the opposite cotangents of both diagonals, times k"""
    roots: wp.vec4
    """Root of k / s^3 of each triangle, s the last number of its shape: its square over det M, times each opposite
    product, is subtracted from an edge's tension"""
    steep: wp.vec2
    """Largest contribution of two opposite squared edges to a triangle's trace, over its shape's last number and k"""


@cache
def sums_reader(features: Features) -> Any:
    """Return the function that reads the rest sums of a quad, which hold as long as the balloon's numbers do."""
    slopes_of_law, thickness = (
        choice_of_laws(features.membranes, features.columns),
        features.columns.places["thickness"],
    )

    @wp.func
    def read_sums(t: Tables, face: wp.int32, material: wp.int32, n: Any):
        count = t.membranes.membrane_faces.corners.shape[0]
        by_trace, _by_det = slopes_of_law(2.0, 1.0, 0.0, material, n, 0)
        k = PART * n[thickness] * by_trace
        last = four_floats_at(t.membranes.membrane_faces.sums, 2 * count + face)
        sums = Sums()
        sums.along = k * four_floats_at(t.membranes.membrane_faces.sums, face)
        sums.roots = wp.sqrt(k) * four_floats_at(t.membranes.membrane_faces.sums, count + face)
        sums.across = k * wp.vec2(last[0], last[1])
        sums.steep = wp.vec2(last[2], last[3]) / k
        return sums

    return read_sums


@cache
def tensions_whatever(features: Features) -> Any:
    """Return the function for the tensions of a quad in any state."""
    tension = tension_function(features)

    @wp.func
    def tension_at(t: Tables, face: wp.int32, corner: wp.int32, metric: wp.vec3, material: wp.int32, n: Any):
        rest = four_floats_at(
            t.membranes.membrane_faces.rests, corner * t.membranes.membrane_faces.corners.shape[0] + face
        )
        return tension(metric, wp.vec3(), rest, material, n, 0)

    @wp.func
    def pulls_whatever(t: Tables, face: wp.int32, metrics: Metrics, material: wp.int32, n: Any):
        a = tension_at(t, face, 0, metrics.a, material, n)
        b = tension_at(t, face, 1, metrics.b, material, n)
        c = tension_at(t, face, 2, metrics.c, material, n)
        d = tension_at(t, face, 3, metrics.d, material, n)
        along = wp.vec4(
            a[0] + a[1] + b[2] + b[1],
            b[0] + b[1] + c[2] + c[1],
            c[0] + c[1] + d[2] + d[1],
            d[0] + d[1] + a[2] + a[1],
        )
        return along, wp.vec2(-1.0 * b[1] - d[1], -1.0 * a[1] - c[1])

    return pulls_whatever


@wp.func
def taken(metric: wp.vec3, root: float):
    """Return the part that is subtracted for each product at an angle [N/m^3]."""
    each = root / (metric[0] * metric[2] - metric[1] * metric[1])
    return each * each


@cache
def quad_tensions(features: Features) -> Any:
    """Return the function for the pulls of edges and of both diagonals, over their vectors [N/m]."""
    pulls_whatever = tensions_whatever(features)

    @wp.func
    def pulls(t: Tables, face: wp.int32, metrics: Metrics, rest: Sums, material: wp.int32, n: Any):
        a = taken(metrics.a, rest.roots[0])
        b = taken(metrics.b, rest.roots[1])
        c = taken(metrics.c, rest.roots[2])
        d = taken(metrics.d, rest.roots[3])
        trace = rest.steep[0] * wp.max(metrics.a[0], metrics.c[0])
        trace += rest.steep[1] * wp.max(metrics.b[0], metrics.d[0])
        if wp.max(wp.max(a, b), wp.max(c, d)) * trace < 1.0:  # see `tautness`
            at_a = products_at_angles(metrics.a)
            at_b = products_at_angles(metrics.b)
            at_c = products_at_angles(metrics.c)
            at_d = products_at_angles(metrics.d)
            along = wp.vec4(
                rest.along[0] - a * at_a[0] - b * at_b[1],
                rest.along[1] - b * at_b[0] - c * at_c[1],
                rest.along[2] - c * at_c[0] - d * at_d[1],
                rest.along[3] - d * at_d[0] - a * at_a[1],
            )
            return along, wp.vec2(
                rest.across[0] - b * at_b[2] - d * at_d[2], rest.across[1] - a * at_a[2] - c * at_c[2]
            )
        return pulls_whatever(t, face, metrics, material, n)

    return pulls


class Quads(NamedTuple):
    """Hold the functions of a thread that keeps quads."""

    hold: Any
    """(t, world, n, thread): its quads, kept as a frame begins"""
    stretch: Any
    """(t, world, thread, numbers, films, points, pulls, area_vectors): all of its quads; with the numbers of a
    balloon, if there is one alone"""


@cache
def quad_reader(features: Features) -> tuple[Any, Any]:
    """Return the type of a quad at rest, and the function that reads one."""
    read_sums, read_numbers = sums_reader(features), numbers_reader(features.columns)

    @wp.struct
    class Quad:
        """A quad at rest."""

        corners: wp.vec4i  # where their points begin in a tile, in bytes
        balloon: wp.int32
        rest: Sums

    @wp.func
    def read_quad(t: Tables, world: wp.int32, n: Any, number: wp.int32):
        face = wp.min(number, t.membranes.membrane_faces.corners.shape[0] - 1)
        quad = Quad()
        quad.corners = four_ints_at(t.membranes.membrane_faces.corners, face)
        if wp.static(features.balloons > 1):
            quad.balloon = t.membranes.membrane_faces.balloons[face]
            numbers = read_numbers(t, world, quad.balloon)
            quad.rest = read_sums(t, face, t.membranes.materials[quad.balloon], numbers)
        else:
            quad.rest = read_sums(t, face, t.membranes.materials[0], n)
        return quad

    return Quad, read_quad


@cache
def quad_measure(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function that measures a quad that a thread keeps."""
    Quad, _ = quad_reader(features)  # noqa: N806 - a type
    put, point_at, step = (getattr(membrane_face_places(membrane_face), name) for name in ("put", "point_at", "step"))
    pulls_of_quad, room = quad_tensions(features), membrane_face.room

    @wp.func
    def measure(t: Tables, n: Any, quad: Quad, face: wp.int32, points: Any, pulls: Any, area_vectors: Any):
        """Store the forces of a quad on its corners, by one thread."""
        a = point_at(points, quad.corners[0])
        b = point_at(points, quad.corners[1])
        c = point_at(points, quad.corners[2])
        d = point_at(points, quad.corners[3])
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        ac = c - a
        bd = d - b
        metrics = products_between(ab, bc, cd, da)
        material = t.membranes.materials[quad.balloon]
        along, across = pulls_of_quad(
            t, wp.min(face, t.membranes.membrane_faces.corners.shape[0] - 1), metrics, quad.rest, material, n
        )
        on_a, on_b, on_c, on_d = pulls_between_corners(ab, bc, cd, da, ac, bd, along, across)
        area_a, area_b, area_c, area_d = crosses_at_quad_corners(ab, bc, da, ac, bd)
        put(pulls, area_vectors, step * face, on_a, area_a)
        put(pulls, area_vectors, step * (room + face), on_b, area_b)
        put(pulls, area_vectors, step * (2 * room + face), on_c, area_c)
        put(pulls, area_vectors, step * (3 * room + face), on_d, area_d)

    return measure


@cache
def quads_of(features: Features, membrane_face: MembraneFaceLayout) -> Quads:
    """Return the functions of quads for a layout whose threads keep them, and store area vectors, too."""
    quads, threads = membrane_face.quads, membrane_face.room // membrane_face.quads
    Quad, read_quad = quad_reader(features)  # noqa: N806 - a type
    measure, read_numbers = quad_measure(features, membrane_face), numbers_reader(features.columns)

    @wp.struct
    class Held:
        """Rest data of quads that a thread keeps."""

        first: Quad
        second: Quad

    @wp.func
    def hold(t: Tables, world: wp.int32, n: Any, thread: wp.int32):
        held = Held()
        held.first = read_quad(t, world, n, thread)
        if wp.static(quads > 1):
            held.second = read_quad(t, world, n, thread + threads)
        return held

    @wp.func
    def measure_numbered(
        t: Tables, world: wp.int32, n: Any, quad: Quad, face: wp.int32, points: Any, pulls: Any, area_vectors: Any
    ):
        """Store the forces of a quad on its corners, with the numbers of its balloon."""
        if wp.static(features.balloons == 1):
            measure(t, n, quad, face, points, pulls, area_vectors)
        else:
            numbers = read_numbers(t, world, quad.balloon)
            measure(t, numbers, quad, face, points, pulls, area_vectors)

    @wp.func
    def stretch(
        t: Tables,
        world: wp.int32,
        thread: wp.int32,
        numbers: Any,
        membrane_faces: Held,
        points: Any,
        pulls: Any,
        area_vectors: Any,
    ):
        measure_numbered(t, world, numbers, membrane_faces.first, thread, points, pulls, area_vectors)
        if wp.static(quads > 1):
            measure_numbered(t, world, numbers, membrane_faces.second, thread + threads, points, pulls, area_vectors)

    return Quads(hold, stretch)


@wp.func
def products_of(ab: Any, bc: Any, cd: Any, da: Any):
    """Return the dot products of edges at each corner, a row a corner.

    Products of the first edge with itself and with the one before. A local array would have its address and strides
    written for every quad.
    """
    squares = Lanes4()
    mixed = Lanes4()
    squares[0] = dot_product(ab, ab)
    squares[1] = dot_product(bc, bc)
    squares[2] = dot_product(cd, cd)
    squares[3] = dot_product(da, da)
    mixed[0] = -dot_product(ab, da)
    mixed[1] = -dot_product(bc, ab)
    mixed[2] = -dot_product(cd, bc)
    mixed[3] = -dot_product(da, cd)
    return squares, mixed


@wp.func
def rates_of(ab: Any, bc: Any, cd: Any, da: Any, a: Any, b: Any, c: Any, d: Any):
    """Return the rates of change of `products_of`, where a to d are the velocities of the corners."""
    squares = Lanes4()
    mixed = Lanes4()
    squares[0] = 2.0 * dot_product(ab, b - a)
    squares[1] = 2.0 * dot_product(bc, c - b)
    squares[2] = 2.0 * dot_product(cd, d - c)
    squares[3] = 2.0 * dot_product(da, a - d)
    mixed[0] = -(dot_product(ab, a - d) + dot_product(da, b - a))
    mixed[1] = -(dot_product(bc, b - a) + dot_product(ab, c - b))
    mixed[2] = -(dot_product(cd, c - b) + dot_product(bc, d - c))
    mixed[3] = -(dot_product(da, d - c) + dot_product(cd, a - d))
    return squares, mixed


@cache
def tensions_function(features: Features, surely_taut: bool) -> Any:
    """Return the function for the tensions of the triangles of a quad, as `pulls_on_corners` takes them.

    Args:
        surely_taut: whether all are known to be taut, see `how_surely_taut`, so that it takes less.
    """
    tension, taut_tension = tension_function(features), taut_tension_function(features)

    @wp.func
    def tensions(t: Any, params: Any, d11: Lanes4, d12: Lanes4, r11: Lanes4, r12: Lanes4):
        """Return the tensions of a quad from the dot products of its edges and their rates."""
        material = t.all.membranes.materials[params.balloon]
        along, mixed, back = Lanes4(), Lanes4(), Lanes4()
        for corner in range(t.quad_triangles[params.number]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            f11 = r11[corner]
            f12 = r12[corner]
            f22 = r11[(corner + 3) % 4]
            rests = t.quad_rests[4 * params.number + corner]
            t11, t12, t22 = Lanes(), Lanes(), Lanes()
            for lane in range(LANE_COUNT):
                metric = wp.vec3(e11[lane], e12[lane], e22[lane])
                if wp.static(surely_taut):
                    pulls = taut_tension(metric, of_lane(rests, lane), material, params.n, lane)
                else:
                    rate = wp.vec3(f11[lane], f12[lane], f22[lane])
                    pulls = tension(metric, rate, of_lane(rests, lane), material, params.n, lane)
                t11[lane] = pulls[0]
                t12[lane] = pulls[1]
                t22[lane] = pulls[2]
            along[corner] = t11
            mixed[corner] = t12
            back[(corner + 3) % 4] = t22
        return along, mixed, back

    return tensions


@wp.func
def are_surely_taut(t: Any, params: Any, d11: Lanes4, d12: Lanes4):
    """Return whether all triangles of a quad are surely taut, in all lanes."""
    surely = bool(True)
    for corner in range(t.quad_triangles[params.number]):
        e11 = d11[corner]
        e12 = d12[corner]
        e22 = d11[(corner + 3) % 4]
        rests = t.quad_rests[4 * params.number + corner]
        excess = Lanes()
        for lane in range(LANE_COUNT):
            surplus = how_surely_taut(wp.vec3(e11[lane], e12[lane], e22[lane]), of_lane(rests, lane))
            excess[lane] = surplus - NEVER_ZERO
        surely = surely and not any_negative(excess)
    return surely


@cache
def quad_wear(features: Features, at: Any, world_of: Any) -> Any:
    """Return the function for the wear of quads.

    Args:
        at: the function that reads eight points.
        world_of: the one that gives the world in a lane.
    """
    wear = wear_of_triangle(features)

    @wp.func
    def wear_of_quad(t: Any, points: Any, params: Any, peaks: wp.array2d[float]):
        """Find the factors of wear on the tensions of a quad's triangles, and keep their peak stretches."""
        corners = 4 * params.number
        a = at(points, entry_at(t.quads, corners))
        b = at(points, entry_at(t.quads, corners + 1))
        c = at(points, entry_at(t.quads, corners + 2))
        d = at(points, entry_at(t.quads, corners + 3))
        d11, d12 = products_of(b - a, c - b, d - c, a - d)
        material = t.all.membranes.materials[params.balloon]
        for corner in range(t.quad_triangles[params.number]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            rests = t.quad_rests[corners + corner]
            numbers = t.quad_numbers[corners + corner]
            kept, left = Lanes(), Lanes()
            for lane in range(LANE_COUNT):
                kept[lane] = peaks[world_of(t, params, lane), wp.max(of_lane(numbers, lane), 0)]
            for lane in range(LANE_COUNT):
                metric = wp.vec3(e11[lane], e12[lane], e22[lane])
                of_one, greatest, _stress = wear(
                    t.all, world_of(t, params, lane), params.balloon, material, metric, of_lane(rests, lane),
                    kept[lane], params.n, lane,
                )  # fmt: skip
                left[lane] = of_one
                kept[lane] = greatest
            for back in range(LANE_COUNT):
                lane = LANE_COUNT - 1 - back  # lanes beyond the last world are copies of it: its own comes last
                triangle = of_lane(numbers, lane)
                if triangle >= 0:
                    peaks[world_of(t, params, lane), triangle] = kept[lane]
                    t.all.membranes.wear.left[world_of(t, params, lane), triangle] = left[lane]

    return wear_of_quad


@cache
def quad_pull(features: Features, at: Any, world_of: Any) -> Any:
    """Return the function for the forces of quads on their corners.

    Args:
        at: the function that reads eight points.
        world_of: the one that gives the world in a lane.
    """
    tensions, taut_tensions = (tensions_function(features, surely_taut) for surely_taut in (False, True))

    @wp.func
    def worn(t: Any, params: Any, along: Lanes4, mixed: Lanes4, back: Lanes4):
        """Return the tensions of a quad reduced by the wear of its triangles, see `phases.forces`."""
        for corner in range(t.quad_triangles[params.number]):
            numbers = t.quad_numbers[4 * params.number + corner]
            left = Lanes()
            for lane in range(LANE_COUNT):
                triangle = wp.max(of_lane(numbers, lane), 0)
                left[lane] = t.all.membranes.wear.left[world_of(t, params, lane), triangle]
            along[corner] = times(along[corner], left)
            mixed[corner] = times(mixed[corner], left)
            back[(corner + 3) % 4] = times(back[(corner + 3) % 4], left)
        return along, mixed, back

    @wp.func
    def pull_of_quad(t: Any, points: Any, velocities: Any, params: Any):
        """Return the forces on the four corners of each [N]."""
        corners = 4 * params.number
        first = entry_at(t.quads, corners)
        second = entry_at(t.quads, corners + 1)
        third = entry_at(t.quads, corners + 2)
        fourth = entry_at(t.quads, corners + 3)
        a = at(points, first)
        b = at(points, second)
        c = at(points, third)
        d = at(points, fourth)
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        d11, d12 = products_of(ab, bc, cd, da)
        r11, r12 = Lanes4(), Lanes4()
        along, mixed, back = Lanes4(), Lanes4(), Lanes4()
        if wp.static(features.viscous):
            r11, r12 = rates_of(
                ab, bc, cd, da, at(velocities, first), at(velocities, second), at(velocities, third),
                at(velocities, fourth),
            )  # fmt: skip
            along, mixed, back = tensions(t, params, d11, d12, r11, r12)
        else:
            if are_surely_taut(t, params, d11, d12):
                along, mixed, back = taut_tensions(t, params, d11, d12, r11, r12)
            else:
                along, mixed, back = tensions(t, params, d11, d12, r11, r12)
        if wp.static(features.wears):
            along, mixed, back = worn(t, params, along, mixed, back)
        return pulls_on_corners(ab, bc, cd, da, along, mixed, back)

    return pull_of_quad


class MembraneFaceFunctions(NamedTuple):
    """Hold the functions and layout that phases ask for, see `phases.forces.stretch`."""

    clear: Any
    stretch: Any
    collect: Any
    loops: Loops
    keeps: Any
    """Function that reads the faces that a thread keeps as a frame begins, if it keeps any"""
    layout: MembraneFaceLayout
    keeps_places: bool
    """Whether particles keep where their faces' forces stand"""


@cache
def kept_springs(features: Features, membrane_face: MembraneFaceLayout, slots: Slots) -> tuple[Any, Any]:
    """Return the type of a particle's kept springs and places of faces, and the function that reads them."""
    Springs, read_springs = springs_reader(features, slots)  # noqa: N806 - a type
    read_places = membrane_faces_of(features, membrane_face).read_places

    @wp.struct
    class Kept:
        """Springs, and the places of the faces' forces on the particle."""

        springs: Springs
        places: wp.vec4i

    @wp.func
    def read_kept(t: Tables, slot_table: Any, params: Any, place: wp.int32, active: bool):
        kept = Kept()
        kept.springs = read_springs(t, slot_table, params, place, active)
        kept.places = read_places(t, params, active)
        return kept

    return Kept, read_kept


@wp.func
def area_vector_of_skin(t: Tables, points: Any, params: Any, skin: Any, point: wp.vec3):
    """Return the area vector of a particle [m^2]."""
    return skin.area_vector


@cache
def skin_functions(features: Features, membrane_face: MembraneFaceLayout, slots: Slots | None) -> tuple[Any, Any, Any]:
    """Return functions that collect membrane forces on a particle, and add them and area vectors to its springs' sums.

    The first collects, the second adds to the force, and the third returns the area vector.
    """
    take = membrane_faces_of(features, membrane_face).take
    kept_type: Any = springs_reader(features, slots)[0] if slots else wp.int32
    pull_of_springs = slot_loop(features, slots) if slots else spring_loop(features, in_tile)
    has_springs = slots is None or sum(slots) > 0

    @wp.struct
    class Skin:
        """Membrane forces on a particle, and its springs."""

        springs: kept_type
        pull: wp.vec3
        area_vector: wp.vec3

    @wp.func
    def collect_kept(t: Tables, params: Any, kept: Any, pulls: Any, area_vectors: Any):
        skin = Skin()
        skin.springs = kept.springs
        pull, area_vector = take(t, params, kept.places, pulls, area_vectors)
        skin.pull = pull
        skin.area_vector = area_vector
        return skin

    @wp.func
    def collect(t: Tables, params: Any, pulls: Any, area_vectors: Any):
        skin = Skin()
        pull, area_vector = take(t, params, wp.vec4i(), pulls, area_vectors)
        skin.pull = pull
        skin.area_vector = area_vector
        return skin

    @wp.func
    def pull_of_skin(
        t: Tables, points: Any, velocities: Any, params: Any, skin: Any, point: wp.vec3, velocity: wp.vec3, time: float
    ):
        """Return the net force of springs and faces [N]."""
        if wp.static(has_springs):
            return pull_of_springs(t, points, velocities, params, skin.springs, point, velocity, time) + skin.pull
        else:
            return skin.pull

    return collect_kept if slots else collect, pull_of_skin, area_vector_of_skin


@cache
def membrane_face_functions(
    features: Features, membrane_face: MembraneFaceLayout, slots: Slots | None
) -> MembraneFaceFunctions:
    """Return the functions of faces, and of particles.

    Args:
        slots: of springs that particles keep, if they do.
    """
    membrane_faces = membrane_faces_of(features, membrane_face)
    quads = quads_of(features, membrane_face) if membrane_face.quads else None
    collect, pull, area_vector = skin_functions(features, membrane_face, slots)

    beside = features._replace(membranes=())
    return MembraneFaceFunctions(
        membrane_faces.clear,
        quads.stretch if quads else membrane_faces.stretch,
        collect,
        scalar_loops(beside, in_tile, pull, area_vector if membrane_face.areas else None),
        quads.hold if quads else None,
        membrane_face,
        slots is not None,
    )
