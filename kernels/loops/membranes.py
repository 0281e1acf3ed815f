"""Membranes: triangle by triangle, face by face, and those of a particle.

The energy of a triangle is a function of its edges' products alone, so that its forces are a combination of its edges:
on the corner that edges d1 and d2 begin at, (T11 + T12) d1 + (T12 + T22) d2, with the tensions T along them.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.compose import choice_of_energies, choice_of_laws, numbers_reader
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import number_in
from balloon_warp.kernels.laws.membrane import (
    LEAST_DET,
    compliance_of,
    elastic_tension,
    how_surely_taut,
    invariants_of,
    is_taut,
    mixed_stretch,
    relaxed,
    softened,
    true_stress,
    viscous_tension,
)
from balloon_warp.kernels.loops.areas import CROSSES, crosses_at_quad_corners
from balloon_warp.kernels.memory import (
    found_anew,
    four_floats_at,
    four_ints_at,
    in_tile,
    int_pair_at,
    put_vector,
    vector_at,
)
from balloon_warp.kernels.tables import SLICE, MembraneFaceTable, MembraneTable, Tables, first_entry, row_of_world


@cache
def wear_of_triangle(features: Features) -> Any:
    """Return the function for the wear of a triangle, from the dot products of its edges as in `loops.membranes`.

    It returns the factor on the tension, the greatest energy density so far, and the larger principal true stress.
    """
    energy_of_law = choice_of_energies(features.membranes, features.columns)
    slopes_of_law = choice_of_laws(features.membranes, features.columns)
    wrinkling = features.columns.places["wrinkling"]

    @wp.func
    def wear(
        t: Tables, world: wp.int32, balloon: wp.int32, material: wp.int32, metric: wp.vec3, rest: wp.vec4, peak: float,
        n: Any, lane: wp.int32,
    ):  # fmt: skip
        """Return the factor on the tension [1], the greatest energy density and the larger stress [Pa]."""
        trace, area_squared, spread = invariants_of(mixed_stretch(metric, rest))
        det = wp.max(area_squared, LEAST_DET)
        major = 0.5 * (trace + spread)
        stretched = wp.max(major, 1.0)
        stretch = wp.sqrt(stretched)
        across = 1.0 / stretch
        wrinkles = number_in(n, wrinkling, lane)
        taut = is_taut(det, stretch, wrinkles)
        law_trace = wp.where(taut, trace, stretched + across)
        law_det = wp.where(taut, det, stretch)
        law_spread = wp.where(taut, spread, stretched - across)
        left = float(1.0)
        greatest = float(0.0)
        stress = float(0.0)
        if wp.static(features.softens):
            energy = wp.max(energy_of_law(law_trace, law_det, law_spread, material, n, lane), 0.0)
            greatest = wp.max(peak, energy)
            table = t.membranes.wear
            left = softened(
                energy, greatest,
                of_balloon(table.softening, world, balloon),
                of_balloon(table.softening_energy, world, balloon),
                of_balloon(table.softening_share, world, balloon),
            )  # fmt: skip
        if wp.static(features.bursts):
            by_trace, by_det = slopes_of_law(law_trace, law_det, law_spread, material, n, lane)
            by_trace, by_det = relaxed(by_trace, by_det, major, spread, across, taut, wrinkles)
            stress = left * true_stress(by_trace, by_det, major, major - spread)
        return left, greatest, stress

    return wear


@wp.func
def of_balloon(values: wp.array2d[float], world: wp.int32, balloon: wp.int32):
    """Return a balloon's parameter in a world."""
    return values[row_of_world(world, values.shape[0]), balloon]


@wp.func
def pulls_on_corners(ab: Any, bc: Any, cd: Any, da: Any, along: Any, mixed: Any, back: Any):
    """Return the forces on the corners of a quad [N], or of eight quads: those on the ends of each edge are opposite.

    Args:
        along: T11 of the triangle at each corner [N/m].
        mixed: its T12.
        back: T22 of the triangle at the next corner.
    """
    by_ab = scaled(ab, along[0] + back[0]) - scaled(da, mixed[0]) - scaled(bc, mixed[1])
    by_bc = scaled(bc, along[1] + back[1]) - scaled(ab, mixed[1]) - scaled(cd, mixed[2])
    by_cd = scaled(cd, along[2] + back[2]) - scaled(bc, mixed[2]) - scaled(da, mixed[3])
    by_da = scaled(da, along[3] + back[3]) - scaled(cd, mixed[3]) - scaled(ab, mixed[0])
    return by_ab - by_da, by_bc - by_ab, by_cd - by_bc, by_da - by_cd


@wp.func
def pulls_between_corners(
    ab: wp.vec3, bc: wp.vec3, cd: wp.vec3, da: wp.vec3, ac: wp.vec3, bd: wp.vec3, along: wp.vec4, across: wp.vec2
):
    """Return the forces on the corners of a quad [N], whose sum is zero.

    Args:
        along: pulls of edges over their vectors [N/m].
        across: those of both diagonals.
    """
    on_a = along[0] * ab - along[3] * da + across[0] * ac
    on_b = along[1] * bc - along[0] * ab + across[1] * bd
    on_c = along[2] * cd - along[1] * bc - across[0] * ac
    return on_a, on_b, on_c, -1.0 * (on_a + on_b) - on_c


@cache
def tension_function(features: Features) -> Any:
    """Return the function for the tensions along a triangle's edges."""
    slopes_of_law = choice_of_laws(features.membranes, features.columns)
    columns = features.columns.places
    thickness, wrinkling, damping = (columns[name] for name in ("thickness", "wrinkling", "film_viscosity"))

    @wp.func
    def tension(metric: wp.vec3, rate: wp.vec3, rest: wp.vec4, material: wp.int32, n: Any, lane: wp.int32):
        """Return T11, T12 and T22 [N/m].

        Args:
            metric: d1 . d1, d1 . d2 and d2 . d2 [m^2].
            rate: of their change [m^2/s].
            rest: see `MembraneTable`.
            lane: of the numbers, where they are of eight lanes.
        """
        wrinkles = number_in(n, wrinkling, lane)
        mixed = mixed_stretch(metric, rest)
        trace, area_squared, spread = invariants_of(mixed)
        det = wp.max(area_squared, LEAST_DET)
        major = 0.5 * (trace + spread)
        stretched = wp.max(major, 1.0)
        stretch = wp.sqrt(stretched)
        across = 1.0 / stretch
        taut = is_taut(det, stretch, wrinkles)
        by_trace, by_det = slopes_of_law(
            wp.where(taut, trace, stretched + across),
            wp.where(taut, det, stretch),
            wp.where(taut, spread, stretched - across),
            material, n, lane,
        )  # fmt: skip
        by_trace, by_det = relaxed(by_trace, by_det, major, spread, across, taut, wrinkles)
        double_volume = rest[3] * (2.0 * number_in(n, thickness, lane))
        tensions = elastic_tension(metric, rest, by_trace, by_det, double_volume)
        if wp.static(features.viscous):
            inverse = compliance_of(rest, metric) / det
            tensions += (0.5 * double_volume) * viscous_tension(
                mixed, rate, rest, inverse, major, spread, taut, wrinkles, number_in(n, damping, lane)
            )
        return tensions

    return tension


@cache
def taut_tension_function(features: Features) -> Any:
    """Return a faster function for the tensions of a triangle that is surely taut, without damping.

    It gives the same bits, so that a triangle's do not depend on its neighbors. See `how_surely_taut`.
    """
    slopes_of_law = choice_of_laws(features.membranes, features.columns)
    thickness = features.columns.places["thickness"]

    @wp.func
    def taut_tension(metric: wp.vec3, rest: wp.vec4, material: wp.int32, n: Any, lane: wp.int32):
        """Return T11, T12 and T22 [N/m]."""
        trace, det, spread = invariants_of(mixed_stretch(metric, rest))  # the last is left out where no law asks for it
        by_trace, by_det = slopes_of_law(trace, det, spread, material, n, lane)
        double_volume = rest[3] * (2.0 * number_in(n, thickness, lane))
        return elastic_tension(metric, rest, by_trace, by_det, double_volume)

    return taut_tension


@cache
def triangle_pull(features: Features) -> Any:
    """Return the function for a triangle's force on the corner that its two edges begin at."""
    tension = tension_function(features)

    @wp.func
    def pull_of_triangle(d1: wp.vec3, d2: wp.vec3, v1: wp.vec3, v2: wp.vec3, rest: wp.vec4, material: wp.int32, n: Any):
        """Return the force on a particle, and those on the ends of both edges [N].

        Args:
            d1: the first edge [m].
            v1: how fast it changes [m/s].
        """
        metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
        rate = wp.vec3()
        if wp.static(features.viscous):
            rate = wp.vec3(2.0 * wp.dot(d1, v1), wp.dot(d1, v2) + wp.dot(v1, d2), 2.0 * wp.dot(d2, v2))
        t = tension(metric, rate, rest, material, n, 0)
        first = -(t[0] * d1 + t[1] * d2)
        second = -(t[1] * d1 + t[2] * d2)
        return -(first + second), first, second

    return pull_of_triangle


@cache
def membrane_loop(features: Features, at: Any, velocity_at: Any) -> Any:
    """Return the function that sums the triangles of a particle."""
    pull_of_triangle = triangle_pull(features)

    @wp.func
    def pull_of_membrane(
        membranes: MembraneTable,
        points: Any,
        velocities: Any,
        world: wp.int32,
        particle: wp.int32,
        balloon: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        n: Any,
    ):
        """Return the net force of the membrane on a particle [N]."""
        force = wp.vec3()
        material = membranes.materials[balloon]
        begin = first_entry(membranes.slice_offsets, particle)
        for entry in range(begin, begin + SLICE * membranes.counts[particle], SLICE):
            others = int_pair_at(membranes.others, entry)
            v1 = wp.vec3()
            v2 = wp.vec3()
            if wp.static(features.viscous):
                v1 = velocity_at(velocities, others[0]) - velocity
                v2 = velocity_at(velocities, others[1]) - velocity
            pull, _first, _second = pull_of_triangle(
                at(points, others[0]) - point, at(points, others[1]) - point, v1, v2,
                four_floats_at(membranes.rests, entry), material, n,
            )  # fmt: skip
            if wp.static(features.wears):
                pull *= membranes.wear.left[world, membranes.wear.numbers[entry]]
            force += pull
        return force

    return pull_of_membrane


VECTOR_BYTES = 12
"""Bytes of a point"""
PLACE_BYTES = 8
"""Bytes of an entry of two words; those of four words take twice as many"""


class MembraneFacePlaces(NamedTuple):
    """Functions that go by a place: `step` times a corner times the number of faces plus the face."""

    step: int
    put: Any
    """(pulls, area_vectors, place, pull, area_vector)"""
    get: Any
    """(pulls, area_vectors, place) to the pull [N] and the area vector [m^2]"""
    point_at: Any
    """(points, corner) to the point of a face's corner [m], as the corners stand in the table"""
    velocity_at: Any
    """(velocities, corner) to its velocity [m/s], which is in memory"""


class MembraneFaceLayout(NamedTuple):
    """Hold how a block goes through the faces of membranes."""

    slots: int
    """Largest number of faces at a particle"""
    triangles: int
    """Largest number of triangles at a face"""
    mixed: bool
    """Whether some faces have fewer triangles"""
    areas: bool
    """Whether area vectors are stored, too: the membrane's faces are then all faces"""
    quads: int = 0
    """Number of quads that each thread keeps in registers; 0 where all are read in every substep"""
    tile: int = 0
    """Number of entries in shared memory; 0 where forces are stored in global memory"""
    capacity: int = 0
    """Number of points in a tile"""
    room: int = 0
    """Number of faces that threads have room for, where they keep them"""


def membrane_face_places(membrane_face: MembraneFaceLayout) -> MembraneFacePlaces:
    """Return the storage of a layout with faces of membranes."""
    return (
        in_tiles(membrane_face.tile, membrane_face.capacity, membrane_face.areas) if membrane_face.tile else IN_ARRAYS
    )


def put_words(count: int) -> str:
    """Return code that writes an entry of 2 or 4 words: on a GPU in one instruction, unlike Warp's own."""
    words = ", ".join(f"v[{n}]" for n in range(count))
    entry = entry_of(count)
    return gpu_or_cpu(f"*(float{count}*){entry} = make_float{count}({words});", f"*(wp::vec{count}*){entry} = v;")


def get_words(count: int) -> str:
    """Return code that reads an entry of 2 or 4 words."""
    words = ", ".join(f"v.{axis}" for axis in "xyzw"[:count])
    entry = entry_of(count)
    read = f"const float{count} v = *(const float{count}*){entry}; return wp::vec{count}({words});"
    return gpu_or_cpu(read, f"return *(const wp::vec{count}*){entry};")


def entry_of(count: int) -> str:
    """Return the address of an entry of a number of words in a tile, from a place in units of two words."""
    return f"((char*)tile.data.ptr + {count // 2}u * (unsigned int)place)"


def gpu_or_cpu(gpu: str, cpu: str) -> str:
    """Return code for a GPU and for a CPU."""
    return f"\n#if defined(__CUDA_ARCH__)\n    {gpu}\n#else\n    {cpu}\n#endif\n"


@wp.func_native("return *(const wp::vec3*)((const char*)velocities.data + (unsigned int)byte);")
def velocity_from_byte(velocities: wp.array[wp.vec3], byte: wp.int32) -> wp.vec3:
    """Return a velocity of an array, whose offset is that of its particle's point in the tile."""
    ...


@cache
def in_tiles(places: int, capacity: int, areas: bool) -> MembraneFacePlaces:
    """Return storage in shared memory, in entries of four and of two words, each read by one instruction.

    The first has the force and the first component of the area vector, the second the other two.

    Args:
        places: Number of entries.
        capacity: Number of points that a tile holds.
        areas: Whether area vectors are stored, too.
    """
    Points = wp.tile(dtype=wp.vec3, shape=(capacity,), storage="shared")  # noqa: N806 - types
    Fours = wp.tile(dtype=wp.vec4, shape=(places,), storage="shared")  # noqa: N806
    Twos = wp.tile(dtype=wp.vec2, shape=(places if areas else 1,), storage="shared")  # noqa: N806

    @wp.func_native(put_words(4))
    def put_four(tile: Fours, place: wp.int32, v: wp.vec4): ...

    @wp.func_native(put_words(2))
    def put_two(tile: Twos, place: wp.int32, v: wp.vec2): ...

    @wp.func_native(get_words(4))
    def four_at(tile: Fours, place: wp.int32) -> wp.vec4: ...

    @wp.func_native(get_words(2))
    def two_at(tile: Twos, place: wp.int32) -> wp.vec2: ...

    @wp.func_native("return *(const wp::vec3*)((const char*)tile.data.ptr + (unsigned int)byte);")
    def point_at(tile: Points, byte: wp.int32) -> wp.vec3:
        """Return a point of a tile, from the offset of its first byte."""
        ...

    @wp.func
    def put(pulls: Any, area_vectors: Any, place: wp.int32, pull: wp.vec3, area_vector: wp.vec3):
        put_four(pulls, place, wp.vec4(pull[0], pull[1], pull[2], area_vector[0]))
        if wp.static(areas):
            put_two(area_vectors, place, wp.vec2(area_vector[1], area_vector[2]))

    @wp.func
    def get(pulls: Any, area_vectors: Any, place: wp.int32):
        four = four_at(pulls, place)
        two = wp.vec2()
        if wp.static(areas):
            two = two_at(area_vectors, place)
        return wp.vec3(four[0], four[1], four[2]), wp.vec3(four[3], two[0], two[1])

    return MembraneFacePlaces(PLACE_BYTES, put, get, point_at, velocity_from_byte)


@wp.func
def put_in_array(pulls: Any, area_vectors: Any, place: wp.int32, pull: wp.vec3, area_vector: wp.vec3):
    """Store the force of a membrane's face on a particle."""
    put_vector(pulls, place, pull)


@wp.func
def get_from_array(pulls: Any, area_vectors: Any, place: wp.int32):
    """Return the force of a membrane's face on a particle, and no area vector."""
    return vector_at(pulls, place), wp.vec3()


IN_ARRAYS = MembraneFacePlaces(1, put_in_array, get_from_array, in_tile, vector_at)
"""Storage in global memory, for forces alone"""
OF_TRIANGLE = wp.constant(1.0 / 6.0)
"""Area vector of a corner over the cross product of its edges, from the one before and to the one after"""


@wp.func
def rest_of(membrane_faces: MembraneFaceTable, face: wp.int32, corner: wp.int32):
    """Return the rest metric of the triangle at a corner of a face."""
    return four_floats_at(membrane_faces.rests, corner * membrane_faces.corners.shape[0] + face)


@wp.func
def is_there(corner: wp.int32, rest: wp.vec4):
    """Return whether a face has a triangle at a corner.

    Where some faces have four triangles and some one, a triangle that is absent has no area.
    """
    return corner == 0 or rest[3] > 0.0


@wp.func
def metric_at(corner: wp.int32, d11: wp.vec4, d12: wp.vec4):
    """Return the dot products of the two edges that begin at a corner, or their rates."""
    return wp.vec3(d11[corner], d12[corner], d11[(corner + 3) % 4])


class MembraneFaces(NamedTuple):
    """Hold the functions of faces, and of particles at their corners."""

    clear: Any
    """(t, pulls, area_vectors): the clearing as a frame begins"""
    stretch: Any
    """(t, world, membrane_face, points, velocities, pulls, area_vectors): a face"""
    read_places: Any
    """(t, own, active): a particle's first four places, which it may keep for a frame"""
    take: Any
    """(t, own, kept, pulls, area_vectors): the force on a particle [N], and its area vector [m^2], once all faces are
    measured"""


@cache
def tensions_of(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function for the tensions of a face's triangles."""
    tension, taut_tension = tension_function(features), taut_tension_function(features)
    triangles, mixed, viscous = membrane_face.triangles, membrane_face.mixed, features.viscous

    @wp.func
    def are_surely_taut(membrane_faces: MembraneFaceTable, face: wp.int32, d11: wp.vec4, d12: wp.vec4):
        """Return whether all triangles of a face are surely taut, so that `pulls_if_taut` suffices."""
        least = float(1.0)
        for corner in range(triangles):
            rest = rest_of(membrane_faces, face, corner)
            surely = how_surely_taut(metric_at(corner, d11, d12), rest)
            if wp.static(mixed):
                surely = wp.where(is_there(corner, rest), surely, 1.0)
            least = wp.min(least, surely)
        return least > 0.0

    @wp.func
    def what_is_left(t: Tables, world: wp.int32, face: wp.int32, corner: wp.int32, rest: wp.vec4, pulls: wp.vec3):
        """Return the tensions that are left of a triangle that is worn, or absent."""
        if wp.static(features.wears):
            pulls *= t.membranes.wear.left[world, t.membranes.membrane_faces.numbers[face][corner]]
        if wp.static(mixed):
            pulls = wp.where(is_there(corner, rest), pulls, wp.vec3())
        return pulls

    @wp.func
    def stretch_face(
        t: Tables, world: wp.int32, face: wp.int32, n: Any, d11: wp.vec4, d12: wp.vec4, r11: wp.vec4, r12: wp.vec4
    ):
        """Return the tensions of a face's triangles [N/m].

        Along the edges that begin at each corner, mixed, and along those that end there, as for the corner that they
        begin at.
        """
        membrane_faces = t.membranes.membrane_faces
        material = t.membranes.materials[membrane_faces.balloons[face]]
        along = wp.vec4()
        both = wp.vec4()
        back = wp.vec4()
        surely = bool(False)
        if wp.static(not viscous):
            surely = are_surely_taut(membrane_faces, face, d11, d12)
        if surely:
            for corner in range(triangles):
                rest = rest_of(membrane_faces, face, corner)
                pulls = taut_tension(metric_at(corner, d11, d12), rest, material, n, 0)
                pulls = what_is_left(t, world, face, corner, rest, pulls)
                along[corner] = pulls[0]
                both[corner] = pulls[1]
                back[(corner + 3) % 4] = pulls[2]
        else:
            for corner in range(triangles):
                rest = rest_of(membrane_faces, face, corner)
                metric = metric_at(corner, d11, d12)
                pulls = tension(metric, metric_at(corner, r11, r12), rest, material, n, 0)
                pulls = what_is_left(t, world, face, corner, rest, pulls)
                along[corner] = pulls[0]
                both[corner] = pulls[1]
                back[(corner + 3) % 4] = pulls[2]
        return along, both, back

    return stretch_face


@cache
def face_function(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function that measures a face."""
    step, put, _, point_at, velocity_at = membrane_face_places(membrane_face)
    stretch_face, triangles, areas, viscous = (
        tensions_of(features, membrane_face),
        membrane_face.triangles,
        membrane_face.areas,
        features.viscous,
    )

    @wp.func
    def measure_face(
        t: Tables, world: wp.int32, face: wp.int32, n: Any, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        """Store the forces of a face on its corners, by one thread."""
        count = t.membranes.membrane_faces.corners.shape[0]
        corners = four_ints_at(t.membranes.membrane_faces.corners, face)
        a = point_at(points, corners[0])
        b = point_at(points, corners[1])
        c = point_at(points, corners[2])
        d = point_at(points, corners[3])
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        d11 = wp.vec4(wp.dot(ab, ab), wp.dot(bc, bc), wp.dot(cd, cd), wp.dot(da, da))
        d12 = -1.0 * wp.vec4(wp.dot(ab, da), wp.dot(bc, ab), wp.dot(cd, bc), wp.dot(da, cd))
        r11 = wp.vec4()
        r12 = wp.vec4()
        if wp.static(viscous):
            va = velocity_at(velocities, corners[0])
            vb = velocity_at(velocities, corners[1])
            vc = velocity_at(velocities, corners[2])
            vd = velocity_at(velocities, corners[3])
            vab = vb - va
            vbc = vc - vb
            vcd = vd - vc
            vda = va - vd
            r11 = 2.0 * wp.vec4(wp.dot(ab, vab), wp.dot(bc, vbc), wp.dot(cd, vcd), wp.dot(da, vda))
            r12 = -wp.vec4(
                wp.dot(ab, vda) + wp.dot(da, vab),
                wp.dot(bc, vab) + wp.dot(ab, vbc),
                wp.dot(cd, vbc) + wp.dot(bc, vcd),
                wp.dot(da, vcd) + wp.dot(cd, vda),
            )
        along, both, back = stretch_face(t, world, face, n, d11, d12, r11, r12)
        on_a, on_b, on_c, on_d = pulls_on_corners(ab, bc, cd, da, along, both, back)
        at_a = wp.vec3()
        at_b = wp.vec3()
        at_c = wp.vec3()
        at_d = wp.vec3()
        if wp.static(areas and triangles == 4):
            at_a, at_b, at_c, at_d = crosses_at_quad_corners(ab, bc, da, ab + bc, bc + cd)
        elif wp.static(areas):
            at_a = wp.cross(da, ab)
            at_b = at_a
            at_d = at_a
        put(pulls, area_vectors, step * face, on_a, at_a)
        put(pulls, area_vectors, step * (count + face), on_b, at_b)
        if wp.static(triangles == 4):
            put(pulls, area_vectors, step * (2 * count + face), on_c, at_c)
        put(pulls, area_vectors, step * (3 * count + face), on_d, at_d)

    return measure_face


@cache
def membrane_faces_of(features: Features, membrane_face: MembraneFaceLayout) -> MembraneFaces:
    """Return the functions of films for a layout that has them."""
    step, put, get, _, _ = membrane_face_places(membrane_face)
    measure_face, read_numbers = face_function(features, membrane_face), numbers_reader(features.columns)
    triangles, slots, room, fours = (
        membrane_face.triangles,
        membrane_face.slots,
        membrane_face.room,
        -(-membrane_face.slots // 4),
    )
    keeps_places = membrane_face.tile > 0 and fours == 1

    @wp.func
    def nothing(membrane_faces: MembraneFaceTable):
        """Return the place of an entry that is always zero."""
        if wp.static(room > 0):
            return wp.static(step * 4 * room)
        else:
            return step * 4 * membrane_faces.corners.shape[0]

    @wp.func
    def read_places(t: Tables, params: Any, active: bool):
        places = wp.vec4i()
        if wp.static(keeps_places):
            places = four_ints_at(t.membranes.membrane_faces.places, params.number)
            if not active:
                for slot in range(4):
                    places[slot] = nothing(t.membranes.membrane_faces)
        return places

    @wp.func
    def clear(t: Tables, pulls: Any, area_vectors: Any):
        """Clear the entries that particles with fewer faces than others read."""
        put(pulls, area_vectors, nothing(t.membranes.membrane_faces), wp.vec3(), wp.vec3())

    @wp.func
    def stretch(
        t: Tables, world: wp.int32, membrane_face: wp.int32, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        n = read_numbers(t, world, t.membranes.membrane_faces.balloons[membrane_face])
        measure_face(t, world, membrane_face, n, points, velocities, pulls, area_vectors)

    @wp.func
    def take(t: Tables, params: Any, kept: wp.vec4i, pulls: Any, area_vectors: Any):
        """Sum the forces on a particle in the order of its faces."""
        first = kept
        if wp.static(keeps_places):
            for slot in range(4):
                first[slot] = found_anew(kept[slot])
        else:
            first = four_ints_at(t.membranes.membrane_faces.places, params.number)
        pull, area_vector = get(pulls, area_vectors, first[0])
        for slot in range(1, wp.static(min(slots, 4))):
            more, further = get(pulls, area_vectors, first[slot])
            pull += more
            area_vector += further
        count = t.particles.balloon.shape[0]
        for four in range(1, fours):
            places = four_ints_at(t.membranes.membrane_faces.places, four * count + params.number)
            for slot in range(4):
                more, further = get(pulls, area_vectors, places[slot])
                pull += more
                area_vector += further
        return pull, wp.static(CROSSES if triangles == 4 else OF_TRIANGLE) * area_vector

    return MembraneFaces(clear, stretch, read_places, take)
