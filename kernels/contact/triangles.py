"""Triangles beside a particle: the entries of its list, sides, places, and parameters of a contact.

Eight triangles are measured side by side, in a CPU's vector registers. Each rounds as `loops.contact.place_beside` does
for one triangle, which has the formulas.

A balloon that touches itself has clearances: where a particle or an edge need not search. A search looks farther than
it has to, and keeps how far away the nearest is that a particle or an edge may touch. Until its own way since then, and
that of whatever moved most, have used that up, nothing can be near: a search would find nothing, and is left out. So
results stay the same to the bit, whatever has been left out before.

On a CPU the leaves of it that are near each other are found once for each leaf, and all particles and edges of the leaf
look into those: without, each would look for them by itself, and find mostly its neighborhood on the surface.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.boxes import (
    ARE_NEAR,
    MOVED,
    PACE,
    SPEED,
    box_at,
    end_of_rows,
    exceeds_search_margin,
    first_leaf,
    first_rows,
    pad_function,
    squared_distance_to_box,
    which_leaves_meet,
    which_rows_meet,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, LaneNumbers
from balloon_warp.kernels.laws.touch import FLAT, LEAST
from balloon_warp.kernels.loops.contact import Place, Touching, faced, place_beside, skin_functions
from balloon_warp.kernels.loops.fixtures import friction_of_balloons
from balloon_warp.kernels.memory import float_at, float_in, int_at, triple_at, vector_at
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.warps import first_vote
from balloon_warp.kernels.working import EightPlaces, Working


@wp.func
def are_neighbors(t: Tables, balloon: wp.int32, first: wp.int32, second: wp.int32):
    """Return whether two particles of a balloon were near each other at the start, so that they do not touch."""
    way = vector_at(t.touch.rest_points, second) - vector_at(t.touch.rest_points, first)
    return wp.length_sq(way) < t.touch.apart[balloon] * t.touch.apart[balloon]


@wp.func
def candidate_of(triangle: wp.int32, is_behind: bool, is_first: bool):
    """Return the list entry of a triangle.

    Args:
        is_behind: Whether the particle is behind the triangle.
        is_first: Whether the entry is the first of its balloon.
    """
    return 4 * triangle + wp.where(is_first, 2, 0) + wp.where(is_behind, 1, 0)


@wp.func
def turned(candidate: wp.int32):
    """Return the list entry of a triangle, with the particle on its other side."""
    return candidate ^ 1


@wp.func
def on_side(candidate: wp.int32, place: Place):
    """Return the list entry of a triangle, with the particle on the side of it on which it is."""
    return (candidate & ~1) | wp.where(wp.dot(place.arm, place.area_vector) < 0.0, 1, 0)


@wp.func
def share_corner(t: Tables, first: wp.int32, second: wp.int32):
    """Return whether two triangles have a corner in common."""
    corners = triple_at(t.touch.triangles, first)
    other = triple_at(t.touch.triangles, second)
    shared = bool(False)
    for corner in range(3):
        shared = shared or corners[corner] == other[0] or corners[corner] == other[1] or corners[corner] == other[2]
    return shared


@wp.func
def triangle_of(candidate: wp.int32):
    """Return the triangle of a list entry."""
    return candidate >> 2


@wp.func
def is_first_of_balloon(candidate: wp.int32):
    """Return whether a list entry is the first of its balloon."""
    return (candidate & 2) != 0


@wp.func
def side_of(candidate: wp.int32):
    """Return 1 where the particle is in front of the triangle, -1 behind."""
    return 1.0 - 2.0 * float(candidate & 1)


@wp.func
def rows_at(vectors: wp.array[wp.vec3], corners: wp.vec3i):
    """Return the vectors of a triangle's corners, row by row."""
    return wp.matrix_from_rows(
        vector_at(vectors, corners[0]), vector_at(vectors, corners[1]), vector_at(vectors, corners[2])
    )


@wp.func
def triangle_beside(t: Tables, points: wp.array[wp.vec3], triangle: wp.int32, point: wp.vec3):
    """Return the position of a particle relative to a triangle."""
    corners = rows_at(points, triple_at(t.touch.triangles, triangle))
    return place_beside(point, corners[0], corners[1], corners[2])


@wp.func
def faced_triangle(t: Tables, points: wp.array[wp.vec3], triangle: wp.int32, place: Place):
    """Return the position of a particle relative to a triangle, with normal and gap."""
    corners = rows_at(points, triple_at(t.touch.triangles, triangle))
    return faced(place, corners[0], corners[1], corners[2])


@wp.func
def squared_distance_to_triangle(t: Tables, points: wp.array[wp.vec3], triangle: wp.int32, point: wp.vec3):
    """Return a lower bound of the squared distance to a triangle, that to its box [m^2], which is faster."""
    corners = triple_at(t.touch.triangles, triangle)
    a = vector_at(points, corners[0])
    b = vector_at(points, corners[1])
    c = vector_at(points, corners[2])
    return squared_distance_to_box(point, wp.min(wp.min(a, b), c), wp.max(wp.max(a, b), c))


@wp.func
def relative_speed(t: Tables, velocities: wp.array[wp.vec3], triangle: wp.int32, velocity: wp.vec3):
    """Return the speed of a particle relative to a triangle's center [m/s]."""
    corners = rows_at(velocities, triple_at(t.touch.triangles, triangle))
    mean = (corners[0] + corners[1] + corners[2]) / 3.0
    return wp.length(velocity - mean)


@wp.func
def is_behind(t: Tables, triangle: wp.int32, place: Place, behind: bool, beside: wp.int32):
    """Return whether a particle is behind a triangle.

    Args:
        behind: Whether it is behind the nearest one, which counts for all that it joins.
        beside: The nearest one, whose neighbors alone it joins; -1 if it joins all.
    """
    if beside >= 0 and not share_corner(t, triangle, beside):
        return wp.dot(place.arm, place.area_vector) < 0.0
    return behind


@wp.func
def keep_side(
    t: Tables,
    working: Working,
    world: wp.int32,
    particle: wp.int32,
    nearest: wp.int32,
    hold: float,
    within: float,
    points: wp.array[wp.vec3],
    begin: wp.int32,
    end: wp.int32,
):
    """Keep a particle on the side of its nearest triangle on which it was held, unless another one holds it there.

    Args:
        hold: that of the particle, with the side as its sign.
        within: distance at which another one may hold it [m].
    """
    point = vector_at(points, particle)
    for at in range(begin, end):
        candidate = working.candidates[world, particle, at]
        triangle = triangle_of(candidate)
        if side_of(candidate) * hold > 0.0 and not share_corner(t, triangle, nearest):
            place = triangle_beside(t, points, triangle, point)
            if place.squared < within * within:
                return
    for at in range(begin, end):
        candidate = working.candidates[world, particle, at]
        if share_corner(t, triangle_of(candidate), nearest):
            working.candidates[world, particle, at] = turned(candidate)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    typedef int eight_flags __attribute__((vector_size(32), aligned(4)));
    float corners[3][3][8];
    for (int lane = 0; lane < 8; ++lane)
        for (int corner = 0; corner < 3; ++corner) {
            const wp::vec3 here = points.data[(unsigned int)triangles.data[(unsigned int)numbers[lane]][corner]];
            for (int axis = 0; axis < 3; ++axis)
                corners[corner][axis][lane] = here[axis];
        }
    const auto at = [&](int corner, int axis) { return *reinterpret_cast<const eight*>(corners[corner][axis]); };
    eight ab[3], ac[3], from_a[3], from_b[3], from_c[3];
    for (int axis = 0; axis < 3; ++axis) {
        ab[axis] = at(1, axis) - at(0, axis);
        ac[axis] = at(2, axis) - at(0, axis);
        from_a[axis] = point[axis] - at(0, axis);
        from_b[axis] = point[axis] - at(1, axis);
        from_c[axis] = point[axis] - at(2, axis);
    }
    const auto dot = [](const eight* u, const eight* v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; };
    const eight d1 = dot(ab, from_a), d2 = dot(ac, from_a), d3 = dot(ab, from_b), d4 = dot(ac, from_b);
    const eight d5 = dot(ab, from_c), d6 = dot(ac, from_c);
    const eight beside_c = d1 * d4 - d3 * d2, beside_b = d5 * d2 - d1 * d6, beside_a = d3 * d6 - d5 * d4;
    const eight whole = beside_a + beside_b + beside_c;
    const eight_flags along_ab = (d1 >= 0.0f) & (d3 <= 0.0f) & (d1 > d3), along_ac = (d2 >= 0.0f) & (d6 <= 0.0f);
    const eight_flags at_a = (d1 <= 0.0f) & (d2 <= 0.0f);
    eight_flags left = ~at_a;
    const eight_flags at_b = left & (d3 >= 0.0f) & (d4 <= d3);
    left &= ~at_b;
    eight_flags on_ab = left & (beside_c <= 0.0f) & along_ab;
    left &= ~on_ab;
    const eight_flags at_c = left & (d6 >= 0.0f) & (d5 <= d6);
    left &= ~at_c;
    eight_flags on_ac = left & (beside_b <= 0.0f) & along_ac;
    left &= ~on_ac;
    eight_flags on_bc = left & (beside_a <= 0.0f) & (d4 - d3 >= 0.0f) & (d5 - d6 >= 0.0f);
    left &= ~on_bc;
    const eight_flags flat = left & (whole <= flatness * dot(ab, ab) * dot(ac, ac));
    on_ab |= flat & along_ab;
    on_ac |= flat & ~along_ab & along_ac;
    on_bc |= flat & ~along_ab & ~along_ac;
    const eight none = d1 - d1, one = none + 1.0f;
    const auto quotient = [&](eight part, eight whole) {
        return whole > least ? part / (whole > least ? whole : none + least) : none;
    };
    const eight part = quotient(on_ab ? d1 : on_ac ? d2 : on_bc ? d4 - d3 : beside_b,
                                on_ab ? d1 - d3 : on_ac ? d2 - d6 : on_bc ? (d4 - d3) + (d5 - d6) : whole);
    const eight other = quotient(beside_c, whole), rest = one - part;
    eight* row = reinterpret_cast<eight*>(places.data);
    row[0] = at_a ? one : (at_b | at_c | on_bc) ? none : (on_ab | on_ac) ? rest : rest - other;
    row[1] = at_b ? one : (at_a | at_c | on_ac) ? none : on_bc ? rest : part;
    row[2] = at_c ? one : (at_a | at_b | on_ab) ? none : (on_ac | on_bc) ? part : other;
    for (int axis = 0; axis < 3; ++axis)
        row[3 + axis] = point[axis] - (row[0] * at(0, axis) + row[1] * at(1, axis) + row[2] * at(2, axis));
    row[6] = dot(row + 3, row + 3);
    row[7] = ab[1] * ac[2] - ab[2] * ac[1];
    row[8] = ab[2] * ac[0] - ab[0] * ac[2];
    row[9] = ab[0] * ac[1] - ab[1] * ac[0];
    """
)
def native_places(
    points: wp.array[wp.vec3], triangles: wp.array[wp.vec3i], numbers: LaneNumbers, point: wp.vec3, least: float,
    flatness: float, places: wp.array[EightPlaces],
):  # fmt: skip
    """Find the positions of a particle relative to eight triangles."""
    ...


@wp.func
def find_places(
    points: wp.array[wp.vec3], triangles: wp.array[wp.vec3i], numbers: LaneNumbers, point: wp.vec3,
    places: wp.array[EightPlaces],
):  # fmt: skip
    """Find the positions of a particle relative to eight triangles."""
    native_places(points, triangles, numbers, point, LEAST, FLAT, places)


@wp.func_native("return places.data[0].data[row][lane];")
def entry_of(places: wp.array[EightPlaces], row: wp.int32, lane: wp.int32) -> float:
    """Return a number of one of eight."""
    ...


@wp.func
def vector_of(places: wp.array[EightPlaces], row: wp.int32, lane: wp.int32):
    """Return a vector of one of eight."""
    return wp.vec3(entry_of(places, row, lane), entry_of(places, row + 1, lane), entry_of(places, row + 2, lane))


@wp.func
def place_of(places: wp.array[EightPlaces], lane: wp.int32):
    """Return the position relative to one of the triangles."""
    place = Place()
    place.weights = vector_of(places, 0, lane)
    place.arm = vector_of(places, 3, lane)
    place.squared = entry_of(places, 6, lane)
    place.area_vector = vector_of(places, 7, lane)
    return place


@wp.func
def eight_of_list(candidates: wp.array[wp.int32], begin: wp.int32, count: wp.int32):
    """Return the triangles of a particle's list from a place on, and the last one again where it ends."""
    numbers = LaneNumbers()
    for lane in range(LANE_COUNT):
        numbers[lane] = triangle_of(candidates[wp.min(begin + lane, count - 1)])
    return numbers


@wp.func
def inverse_mass_of(t: Tables, mass_of_balloon: float, particle: wp.int32):
    """Return the inverse mass of a particle [1/kg], 0 if it is fixed."""
    mass = float_at(t.particles.mass_share, particle) * mass_of_balloon
    return wp.where(mass > 0.0, 1.0 / mass, 0.0)


@wp.func
def contacts_at(working: Working, world: wp.int32, particle: wp.int32, inverse_mass: float):
    """Return the contacts of a particle; none if it is fixed."""
    return wp.where(inverse_mass > 0.0, float_in(working.contacts, world, particle), 0.0)


@wp.func
def contacts_of_corners(working: Working, world: wp.int32, corners: wp.vec3i, masses: wp.vec4):
    """Return the contacts of the busiest corner of a triangle."""
    return wp.max(
        wp.max(contacts_at(working, world, corners[0], masses[1]), contacts_at(working, world, corners[1], masses[2])),
        contacts_at(working, world, corners[2], masses[3]),
    )


@cache
def mass_function(features: Features) -> Any:
    """Return the function for a balloon's mass."""
    mass_column = features.columns.places["mass"]

    @wp.func
    def mass_of(t: Tables, world: wp.int32, balloon: wp.int32):
        """Return a balloon's mass [kg]."""
        return t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, mass_column]

    return mass_of


@cache
def pair_functions(features: Features) -> tuple[Any, Any, Any]:
    """Return the functions for the parameters of near pairs, for masses, and for the parameters of pushing pairs."""
    thickness_between, stiffness_between = skin_functions(features)
    mass_of = mass_function(features)

    @wp.func
    def beside(t: Tables, world: wp.int32, particle: wp.int32, candidate: wp.int32, corners: wp.vec3i):
        """Return the parameters that tell whether a pair touches."""
        inputs = Touching()
        inputs.side = side_of(candidate)
        balloon = int_at(t.particles.balloon, particle)
        other = int_at(t.particles.balloon, corners[0])
        inputs.thickness = thickness_between(t, world, balloon, other)
        inputs.step_seconds = t.step_seconds
        return inputs

    @wp.func
    def masses_of(t: Tables, world: wp.int32, particle: wp.int32, corners: wp.vec3i):
        """Return the inverse masses of a particle and of a triangle's corners [1/kg]."""
        its_mass = mass_of(t, world, int_at(t.particles.balloon, corners[0]))
        return wp.vec4(
            inverse_mass_of(t, mass_of(t, world, int_at(t.particles.balloon, particle)), particle),
            inverse_mass_of(t, its_mass, corners[0]),
            inverse_mass_of(t, its_mass, corners[1]),
            inverse_mass_of(t, its_mass, corners[2]),
        )

    @wp.func
    def pressed(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, corners: wp.vec3i, inputs: Touching,
        first: bool,
    ):  # fmt: skip
        """Return the parameters of a pair that pushes, of those that tell whether it touches."""
        balloon = int_at(t.particles.balloon, particle)
        other = int_at(t.particles.balloon, corners[0])
        pressing = Touching()
        pressing.side = inputs.side
        pressing.thickness = inputs.thickness
        pressing.step_seconds = inputs.step_seconds
        pressing.masses = inputs.masses
        pressing.stiffness = stiffness_between(t, world, balloon, other)
        pressing.friction = friction_of_balloons(t, world, balloon, other)
        pressing.first = first
        pressing.crowd = wp.max(
            contacts_at(working, world, particle, inputs.masses[0]) / float_at(t.touch.crowd, balloon),
            contacts_of_corners(working, world, corners, inputs.masses) / float_at(t.touch.crowd, other),
        )
        return pressing

    return beside, masses_of, pressed


SEARCH_MARGIN = wp.constant(5.0)
"""Distance by which a search looks farther than it has to, over a balloon's slack"""
ROUNDED = wp.constant(0.999)
"""Fraction of a clearance that is safe from rounding"""


@wp.func
def search_margin(t: Tables, balloon: wp.int32):
    """Margin of a search beyond the contact distance [m]."""
    return SEARCH_MARGIN * t.touch.slack[balloon]


@wp.func
def clearance_left(working: Working, world: wp.int32, balloon: wp.int32, clearance: float, moved: float):
    """Remaining clearance [m].

    Args:
        moved: Distance that its owner has moved since it was found [m].
    """
    return ROUNDED * clearance - moved - working.balloon_boxes[world, balloon, PACE][MOVED]


@wp.func
def fastest_of(working: Working, world: wp.int32, balloon: wp.int32):
    """Return the highest speed of a balloon's particles [m/s]."""
    return working.balloon_boxes[world, balloon, PACE][SPEED]


@wp.func
def uses_search_margin(t: Tables, working: Working, world: wp.int32, balloon: wp.int32):
    """Test for a balloon so slow that clearances outlast the next search."""
    return 2.0 * t.touch.seconds * fastest_of(working, world, balloon) < search_margin(t, balloon)


@wp.func
def pad_with_search_margin(t: Tables, working: Working, world: wp.int32, balloon: wp.int32, pad: float):
    """Search distance of a balloon's boxes, which contain their particles' displacements [m]."""
    if uses_search_margin(t, working, world, balloon):
        return pad + 2.0 * t.touch.seconds * fastest_of(working, world, balloon) + search_margin(t, balloon)
    return pad


@wp.func
def is_clear_of_own(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, item: wp.int32, clearances: wp.array2d[float],
    moved: float, speed: float, pad: float,
):  # fmt: skip
    """Clearance test: a particle or an edge cannot touch its own balloon until the next search.

    Args:
        moved: Distance that it has moved since the last search [m].
        speed: Its speed [m/s].
        pad: Distance at which it is near [m].
    """
    left = clearance_left(working, world, balloon, clearances[world, item], moved)
    if exceeds_search_margin(working, world, balloon):
        clearances[world, item] = left
    return left > pad + t.touch.seconds * (speed + fastest_of(working, world, balloon))


@wp.func
def keep_clearance(working: Working, world: wp.int32, balloon: wp.int32, particle: wp.int32, distance: float):
    """Keep a particle's distance from triangles of its balloon that it may touch [m], if that is where it is now."""
    working.clearances[world, particle] = wp.where(exceeds_search_margin(working, world, balloon), distance, 0.0)


MOST_LEAVES = wp.constant(32)
"""Largest number of leaves near a leaf that are listed; where there are more, all are searched"""
TOO_MANY = wp.constant(-1)
"""Number of near leaves where there are more than fit"""


@wp.func
def list_near_leaves(t: Tables, working: Working, world: wp.int32, balloon: wp.int32, leaf: wp.int32, pad: float):
    """List the leaves of a balloon that may come within a distance of a leaf [m]."""
    around = box_at(working.leaf_boxes, world, leaf)
    count = wp.int32(0)
    rows = first_rows(t, balloon)
    while rows < end_of_rows(t, balloon):
        near_rows = which_rows_meet(t, working, world, rows, around, pad)
        while near_rows != 0:
            row = rows + first_vote(near_rows)
            near_rows = near_rows & (near_rows - 1)
            leaves = which_leaves_meet(t, working, world, balloon, row, around, pad)
            while leaves != 0:
                if count < MOST_LEAVES:
                    working.near_leaves[world, leaf, count] = 8 * row + first_vote(leaves)
                leaves = leaves & (leaves - 1)
                count += 1
        rows += 8
    working.near_leaf_counts[world, leaf] = wp.where(count > MOST_LEAVES, TOO_MANY, count)


@cache
def near_leaves_kernel(features: Features) -> Any:
    """Return the kernel that lists the leaves near each leaf, on a CPU."""
    pad_between = pad_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_near_leaves(
        # model
        t: Tables,
        # out
        working: Working,
    ):
        """List the leaves near each leaf of the same balloon; a thread a world."""
        world = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
            for balloon in range(working.balloon_boxes.shape[1]):
                pad = pad_between(t, world, balloon, balloon)
                for leaf in range(first_leaf(t, balloon), first_leaf(t, balloon + 1)):
                    if uses_search_margin(t, working, world, balloon):  # few search
                        working.near_leaf_counts[world, leaf] = TOO_MANY
                    else:
                        list_near_leaves(t, working, world, balloon, leaf, pad)

    return find_near_leaves
