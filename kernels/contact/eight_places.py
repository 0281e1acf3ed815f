"""Positions of a particle relative to eight triangles side by side, in a CPU's vector registers.

Each rounds as `meeting.place_beside` does for one triangle, which has the formulas.
"""

import warp as wp

from balloon_warp.kernels.contact.triangles import triangle_of
from balloon_warp.kernels.lanes import LANE_COUNT, LaneNumbers
from balloon_warp.kernels.laws.touch import FLAT, LEAST
from balloon_warp.kernels.loops.meeting import Place
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import EightPlaces


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
def eight_of_queue(queue: wp.types.vector(length=16, dtype=wp.int32), begin: wp.int32, count: wp.int32):
    """Return the triangles of a queue from a place on, and the last one again where it ends."""
    numbers = LaneNumbers()
    for lane in range(LANE_COUNT):
        numbers[lane] = queue[wp.min(begin + lane, count - 1)]
    return numbers


@wp.func
def place_in_queue(
    t: Tables, places: wp.array[EightPlaces], points: wp.array[wp.vec3],
    queue: wp.types.vector(length=16, dtype=wp.int32), turn: wp.int32, count: wp.int32, point: wp.vec3,
):  # fmt: skip
    """Return the position relative to a triangle of a queue; of each eighth together with those that follow."""
    if turn % 8 == 0:
        find_places(points, t.touch.triangles, eight_of_queue(queue, turn, count), point, places)
    return place_of(places, turn % 8)


@wp.func
def eight_of_list(candidates: wp.array[wp.int32], begin: wp.int32, count: wp.int32):
    """Return the triangles of a particle's list from a place on, and the last one again where it ends."""
    numbers = LaneNumbers()
    for lane in range(LANE_COUNT):
        numbers[lane] = triangle_of(candidates[wp.min(begin + lane, count - 1)])
    return numbers
