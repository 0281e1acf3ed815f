"""Net force on a particle, or on eight side by side, but for inflation and contacts: where the laws enter.

A liquid loads the faces around a particle. Each face is the fan of triangles about its center, cut at the level.

Of eight particles side by side springs, area vectors and laws on particles are vector instructions throughout. Strings,
water and laws on faces are rarer: for them each lane is looked at by itself, by the loops for one particle. Hinges and
membranes have been added up before, see `phases.forces`.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.algebra import dot_product, plus_scaled, scaled, squared_length
from balloon_warp.kernels.compose import numbers_reader, params_functions
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes4, entry_at, of_lane, set_lane
from balloon_warp.kernels.laws.outer import TriangleLoad, corner_load, triangle_load
from balloon_warp.kernels.laws.springs import FIRST_WING, angle_beyond
from balloon_warp.kernels.loops.areas import CROSSES, area_loop, cross_at_quad_corner, face_measures, hole_loop
from balloon_warp.kernels.loops.membranes import membrane_loop
from balloon_warp.kernels.loops.springs import ring_ends, ring_loop, spring_loop
from balloon_warp.kernels.memory import four_ints_at, in_tile, int_at, vector_at
from balloon_warp.kernels.tables import (
    SLICE,
    FaceTable,
    ForceTable,
    HingeTable,
    RingTable,
    StringTable,
    Tables,
    row_of_world,
)
from balloon_warp.kernels.working import Working


@wp.func
def load_through_center(load: TriangleLoad):
    """Return a quad corner's share of the load on the center."""
    return corner_load(load, 0.25 * load.moments[2], 0.25 * load.areas[2])


@wp.func
def load_of_quad(before: wp.vec3, across: wp.vec3, along: wp.vec3, level: float, up: wp.vec3):
    """Return the load of a quad on one of its corners.

    The arguments are the vectors to the other corners [m], and the height of the water over the corner [m].
    """
    here = wp.vec3()
    center = 0.25 * (before + across + along)
    coming = triangle_load(before, here, center, level, up)
    going = triangle_load(here, along, center, level, up)
    far = triangle_load(along, across, center, level, up)
    last = triangle_load(across, before, center, level, up)
    load = corner_load(coming, coming.moments[1], coming.areas[1]) + load_through_center(coming)
    load += corner_load(going, going.moments[0], going.areas[0]) + load_through_center(going)
    return load + load_through_center(far) + load_through_center(last)


@cache
def ring_wetness_loop(at: Any) -> Any:
    """Return the function that sums a particle's load over the quads that go all around it."""
    ends_at = ring_ends(at)

    @wp.func
    def water_load(rings: RingTable, points: Any, particle: wp.int32, water_level: float, up: wp.vec3):
        """Return the wetted faces' load on a particle, depth times area vector [m^3], and their area [m^2]."""
        total = wp.vec4()
        place = four_ints_at(rings.places, particle)
        point = at(points, particle)
        level = water_level - wp.dot(point, up)
        before = at(points, place[3]) - point
        for entry in range(place[0], place[0] + SLICE * place[1], SLICE):
            ends = ends_at(rings, entry)
            across = at(points, ends[0]) - point
            along = at(points, ends[1]) - point
            lowest = wp.min(wp.min(wp.dot(before, up), wp.dot(across, up)), wp.min(wp.dot(along, up), 0.0))
            if lowest < level:
                total += load_of_quad(before, across, along, level, up)
            before = along
        return total

    return water_load


@cache
def wetness_loop(at: Any) -> Any:
    """Return the function that sums a particle's load over its faces."""
    center_of_face, _ = face_measures(at)

    @wp.func
    def is_dry(faces: FaceTable, points: Any, begin: wp.int32, end: wp.int32, level: float, up: wp.vec3):
        """Return whether all corners of a face, and so the face, are above the water."""
        lowest = wp.dot(at(points, faces.particles[begin]), up)
        for corner in range(begin + 1, end):
            lowest = wp.min(lowest, wp.dot(at(points, faces.particles[corner]), up))
        return lowest >= level

    @wp.func
    def water_load(faces: FaceTable, points: Any, particle: wp.int32, level: float, up: wp.vec3):
        """Return the wetted faces' load on a particle, depth times area vector [m^3], and their area [m^2]."""
        total = wp.vec4()
        for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
            face = faces.around_particles[incidence]
            begin = faces.offsets[face]
            end = faces.offsets[face + 1]
            if not is_dry(faces, points, begin, end, level, up):
                center = center_of_face(faces, points, face)
                of_center = wp.vec4()
                visits = float(0.0)
                p = faces.particles[end - 1]
                for corner in range(begin, end):
                    q = faces.particles[corner]
                    load = triangle_load(at(points, p), at(points, q), center, level, up)
                    if p == particle:
                        total += corner_load(load, load.moments[0], load.areas[0])
                    if q == particle:
                        total += corner_load(load, load.moments[1], load.areas[1])
                        visits += 1.0
                    of_center += corner_load(load, load.moments[2], load.areas[2])
                    p = q
                total += (visits / float(end - begin)) * of_center
        return total

    return water_load


@cache
def inertia_function(features: Features) -> Any:
    """Return the function for a particle's mass with its share of the gas and added mass [kg]; 0 if fixed."""

    @wp.func
    def inertia(working: Working, params: Any):
        if wp.static(features.gas):
            return params.mass + params.share * working.gas_masses[params.world, params.balloon]
        else:
            return params.mass

    return inertia


@cache
def inverse_mass_function(features: Features) -> Any:
    """Return the function for the inverse effective mass of a particle [1/kg], 0 if it is fixed."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def inverse_mass_of(t: Tables, working: Working, world: wp.int32, particle: wp.int32):
        mass = inertia(working, read_params(t, world, particle))
        return wp.where(mass > 0.0, 1.0 / mass, 0.0)

    return inverse_mass_of


@wp.func
def outer_force(forces: ForceTable, world: wp.int32, particle: wp.int32):
    """Return a particle's shares in the forces that drive it, added up [N]."""
    total = wp.vec3()
    row = row_of_world(world, forces.newtons.shape[0])
    for slot in range(0, forces.slots.shape[1], 2):
        share = forces.slots[particle, slot]
        if share > 0.0:
            total += share * forces.newtons[row, wp.int32(forces.slots[particle, slot + 1])]
    return total


@cache
def face_push(features: Features, at: Any, velocity_at: Any) -> Any:
    """Return the function for the force on a corner of a face."""
    laws, read_numbers = features.laws_on("face"), numbers_reader(features.columns)
    center_of_face, area_vector_of_face = face_measures(at)
    moving = features.needs("face", "velocity")

    @wp.func
    def push_at_corner(t: Tables, points: Any, velocities: Any, world: wp.int32, face: wp.int32, time: float):
        """Return one corner's share of the force on a face [N]; zero where it is torn."""
        if wp.static(features.bursts):
            if t.membranes.wear.tears.gone[world, face] == wp.int8(1):
                return wp.vec3()
        begin = int_at(t.faces.offsets, face)
        end = int_at(t.faces.offsets, face + 1)
        corners = float(end - begin)
        center = center_of_face(t.faces, points, face)
        velocity = wp.vec3()
        if wp.static(moving):
            for corner in range(begin, end):
                velocity += velocity_at(velocities, int_at(t.faces.particles, corner)) / corners
        area_vector = area_vector_of_face(t.faces, points, face, center)
        n = read_numbers(t, world, int_at(t.faces.balloon, face))
        return laws(center, area_vector, velocity, t.up, t.step_seconds, time, n) / corners

    return push_at_corner


@wp.func
def visits_of(t: Tables, face: wp.int32, particle: wp.int32):
    """Return how many corners of a face are a particle."""
    visits = float(0.0)
    for corner in range(int_at(t.faces.offsets, face), int_at(t.faces.offsets, face + 1)):
        if int_at(t.faces.particles, corner) == particle:
            visits += 1.0
    return visits


@wp.func
def one_visit(t: Tables, face: wp.int32, particle: wp.int32):
    """Return 1: no face is folded."""
    return float(1.0)


@cache
def visits_function(features: Features) -> Any:
    """Return the function for how often a face visits a particle around which it is: once, but for folded ones."""

    return visits_of if features.revisits else one_visit


@cache
def push_of_faces_function(features: Features) -> Any:
    """Return the function that sums the forces of faces."""
    visits = visits_function(features)

    @wp.func
    def push_of_faces(t: Tables, face_pushes: Any, particle: wp.int32):
        """Return the net force of the faces around a particle [N], each of which has found its corners' share."""
        force = wp.vec3()
        begin = int_at(t.faces.particle_offsets, particle)
        for incidence in range(begin, int_at(t.faces.particle_offsets, particle + 1)):
            face = int_at(t.faces.around_particles, incidence)
            force += visits(t, face, particle) * vector_at(face_pushes, face)
        return force

    return push_of_faces


@cache
def face_loop(features: Features, at: Any, velocity_at: Any) -> Any:
    """Return the function that finds the forces of its faces on a particle, and sums them."""
    push_at_corner, visits = face_push(features, at, velocity_at), visits_function(features)

    @wp.func
    def find_push_of_faces(t: Tables, points: Any, velocities: Any, world: wp.int32, particle: wp.int32, time: float):
        """Return the net force of the faces around a particle [N]."""
        force = wp.vec3()
        for incidence in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
            face = t.faces.around_particles[incidence]
            force += visits(t, face, particle) * push_at_corner(t, points, velocities, world, face, time)
        return force

    return find_push_of_faces


@wp.func
def wing_size(hinges: HingeTable, hinge: wp.int32, wing: wp.int32):
    """Return the corners of a hinge's first (0) or second (1) wing."""
    return hinges.wing_offsets[2 * hinge + wing + 1] - hinges.wing_offsets[2 * hinge + wing]


Places = wp.types.matrix(shape=(4, 3), dtype=wp.float32)
"""Vector for each of a hinge's four roles, a row each"""


@cache
def place_function(at: Any) -> Any:
    """Return the function that returns the positions of a hinge's ends and wings."""

    @wp.func
    def wing_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32, wing: wp.int32):
        """Return the position of a wing: the mean of its corners."""
        total = wp.vec3()
        for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
            total += at(points, hinges.wing_particles[corner])
        return total / float(wing_size(hinges, hinge, wing))

    @wp.func
    def places_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32):
        """Return the positions of a hinge's ends and wings [m]."""
        ends = hinges.ends[hinge]
        return (
            at(points, ends[0]),
            at(points, ends[1]),
            wing_of_hinge(hinges, points, hinge, 0),
            wing_of_hinge(hinges, points, hinge, 1),
        )

    return places_of_hinge


@cache
def hinge_forces(features: Features, at: Any) -> Any:
    """Return the function for the forces at all places of a hinge, whose angle is found once."""
    laws = features.laws_on("hinge")
    places_of_hinge = place_function(at)

    @wp.func
    def forces_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32, n: Any):
        """Return the force on a particle of each role, a row each [N]."""
        a, b, first, second = places_of_hinge(hinges, points, hinge)
        bend = angle_beyond(a, b, first, second, hinges.rest_angles[hinge])
        forces = Places()
        for role in range(4):
            force = laws(role, a, b, first, second, bend, n)
            if role >= FIRST_WING:
                force /= float(wing_size(hinges, hinge, role - FIRST_WING))
            forces[role] = force
        return forces

    return forces_of_hinge


@cache
def hinge_loop(features: Features, at: Any) -> Any:
    """Return the function that sums a particle's hinges."""
    laws = features.laws_on("hinge")
    places_of_hinge = place_function(at)

    @wp.func
    def force_at_role(hinges: HingeTable, points: Any, hinge: wp.int32, role: wp.int32, n: Any):
        """Force on a particle that has this role in a hinge [N]; the corners of a wing share theirs."""
        a, b, first, second = places_of_hinge(hinges, points, hinge)
        bend = angle_beyond(a, b, first, second, hinges.rest_angles[hinge])
        force = laws(role, a, b, first, second, bend, n)
        if role >= FIRST_WING:
            force /= float(wing_size(hinges, hinge, role - FIRST_WING))
        return force

    @wp.func
    def pull_of_hinges(hinges: HingeTable, points: Any, particle: wp.int32, n: Any):
        """Return the net force of a particle's hinges [N]."""
        force = wp.vec3()
        for entry in range(hinges.particle_offsets[particle], hinges.particle_offsets[particle + 1]):
            role = hinges.particle_roles[entry]
            force += force_at_role(hinges, points, role >> 2, role & 3, n)
        return force

    return pull_of_hinges


@cache
def anchor_function(features: Features) -> Any:
    """Return the function that returns the anchor of a string at a time."""

    @wp.func
    def anchor_at(strings: StringTable, world: wp.int32, string: wp.int32, time: float):
        """Return the anchor of a string [m]; between two frames it moves along a line."""
        if wp.static(features.anchors_move):
            begin = strings.anchors[3 * world, strings.anchors.shape[1] - 1][0]
            return strings.anchors[3 * world, string] + (time - begin) * strings.anchors[3 * world + 1, string]
        return strings.anchors[row_of_world(world, strings.anchors.shape[0]), string]

    return anchor_at


@cache
def string_pull(features: Features) -> Any:
    """Return the function for the force of one string."""
    coefficient, anchor_at = features.laws_on("string"), anchor_function(features)

    @wp.func
    def pull_of_string(
        strings: StringTable,
        world: wp.int32,
        string: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        n: Any,
        step_seconds: float,
        time: float,
    ):
        """Force of a string on the particle that it holds [N]."""
        d = anchor_at(strings, world, string, time) - point
        length = strings.lengths[row_of_world(world, strings.lengths.shape[0]), string]
        stiffness = strings.stiffness[row_of_world(world, strings.stiffness.shape[0]), string]
        return d * coefficient(
            squared_length(d), -wp.dot(velocity, d), length, stiffness, stiffness * length, step_seconds, time, n
        )

    return pull_of_string


@cache
def held_string_pull(features: Features) -> Any:
    """Return the function for the force of one string, in the order of the particles held."""
    pull_of_string = string_pull(features)
    read_numbers = numbers_reader(features.columns)

    @wp.func
    def pull_of_held_string(t: Tables, world: wp.int32, held: wp.int32, points: Any, velocities: Any, time: float):
        """Return the force of a string on the particle that it holds [N]."""
        p = t.strings.particles[held]
        n = read_numbers(t, world, t.particles.balloon[p])
        string = t.strings.order[held][0]
        return pull_of_string(t.strings, world, string, points[p], velocities[p], n, t.step_seconds, time)

    return pull_of_held_string


@cache
def string_loop(features: Features) -> Any:
    """Return the function that sums a particle's strings."""
    pull_of_string = string_pull(features)

    @wp.func
    def pull_of_strings(
        strings: StringTable,
        world: wp.int32,
        particle: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        n: Any,
        step_seconds: float,
        time: float,
    ):
        """Return the net force of a particle's strings [N]."""
        force = wp.vec3()
        if strings.offsets.shape[0] > 0:
            for held in range(int_at(strings.offsets, particle), int_at(strings.offsets, particle + 1)):
                force += pull_of_string(strings, world, strings.order[held][0], point, velocity, n, step_seconds, time)
        return force

    return pull_of_strings


class Loops(NamedTuple):
    """Loops over the forces on a particle; they take the particle's `own`, one or eight at a time."""

    around: Any
    """(t, points, velocities, own, springs, point, velocity, time) to the net force of its springs, and where they are
    needed and found on the way, to its area vector and A_p n, see `laws.outer`"""
    others: Any
    """(t, points, velocities, own, point, velocity, time) to that of strings, hinges and membranes; None if
    there are none, or the springs' has it already"""
    water_load: Any
    """(t, points, own)"""
    particle_laws: Any
    """Function from the force so far, the inputs of laws on a particle, and the row of its numbers, to the sum with
    these laws"""


@cache
def net_force_function(features: Features, loops: Loops) -> Any:
    """Return the function that sums the forces on a particle."""
    others = loops.others is not None
    area_vector_of_holes = hole_loop(vector_at) if features.bursts and features.measures_areas else None

    @wp.func
    def net_force(
        t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Any, velocity: Any, water_load: Any,
        time: float,
    ):  # fmt: skip
        """Return the net force [N], and where they are needed, area vector and A_p n of the particle [m^2].

        Args:
            velocities: of all particles, where a law asks for its neighbors'.
            springs: inputs of the loop over springs, beside the tables.
            water_load: see `phases.forces.find_water_load`; anything where there is no liquid.
        """
        force, area_vector, vertex_normal = loops.around(t, points, velocities, params, springs, point, velocity, time)
        if wp.static(others):
            force += loops.others(t, points, velocities, params, point, velocity, time)
        skin = area_vector
        if wp.static(area_vector_of_holes is not None):  # torn faces bound the gas, but no law acts on them
            skin -= area_vector_of_holes(t, points, params.world, params.number, point)
        force = loops.particle_laws(
            force, point, velocity, params.mass, params.share, skin, water_load, t.up, t.step_seconds, time, params.n
        )
        return force, area_vector, vertex_normal

    return net_force


@cache
def one_after_the_other(
    features: Features, pull_of_springs: Any, own_area_vector: Any, own_vertex_normal: Any = None
) -> Any:
    """Return the function that loops over a particle's springs, and then over its faces."""

    @wp.func
    def around(t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Any, velocity: Any, time: float):
        """Force [N], area vector and A_p n [m^2]."""
        force = pull_of_springs(t, points, velocities, params, springs, point, velocity, time)
        area_vector = scaled(point, 0.0)
        vertex_normal = scaled(point, 0.0)
        if wp.static(features.measures_areas):
            area_vector = own_area_vector(t, points, params, springs, point)
        if wp.static(own_vertex_normal is not None):
            vertex_normal = own_vertex_normal(t, points, params, springs, point)
        return force, area_vector, vertex_normal

    return around


@cache
def scalar_loops(
    features: Features,
    at: Any,
    springs: Any = None,
    area_vector: Any = None,
    vertex_normal: Any = None,
    inflation_directions: bool = False,
) -> Loops:
    """Return the loops for one particle at a time.

    Args:
        at: the function that reads a point.
        springs: the loop over springs, if they are not read from the table.
        area_vector: the loop over faces, if it goes another way.
        vertex_normal: the function that finds A_p n, if it does.
        inflation_directions: whether rings find A_p n on the way.
    """
    sum_strings = string_loop(features)
    sum_hinges = hinge_loop(features, at)
    sum_membrane = membrane_loop(features, at, vector_at) if features.membranes else None
    area_vector_of_particle = area_loop(features.quads, at)
    load_of_particle = ring_wetness_loop(at) if features.rings else wetness_loop(at)
    level_column = features.columns.places.get("water_level", 0)
    others = any(features.has(kind) for kind in ("string", "hinge")) or sum_membrane is not None

    @wp.func
    def other_pulls(
        t: Tables, points: Any, velocities: Any, params: Any, point: wp.vec3, velocity: wp.vec3, time: float
    ):
        """Return the net force of strings, hinges and membranes [N]."""
        force = wp.vec3()
        if wp.static(features.has("string")):
            force += sum_strings(
                t.strings, params.world, params.number, point, velocity, params.n, t.step_seconds, time
            )
        if wp.static(features.has("hinge")):
            force += sum_hinges(t.hinges, points, params.number, params.n)
        if wp.static(sum_membrane is not None):
            force += sum_membrane(
                t.membranes, points, velocities, params.world, params.number, params.balloon, point, velocity, params.n
            )
        return force

    @wp.func
    def own_area_vector(t: Tables, points: Any, params: Any, springs: Any, point: wp.vec3):
        """Return the area vector of a particle [m^2]."""
        return area_vector_of_particle(t.fans, points, params.number, point)

    @wp.func
    def own_water_load(t: Tables, points: Any, params: Any):
        """Return depth times area vector [m^3], and wetted area [m^2]."""
        if wp.static(features.rings):
            return load_of_particle(t.rings, points, params.number, params.n[level_column], t.up)
        else:
            return load_of_particle(t.faces, points, params.number, params.n[level_column], t.up)

    if features.rings and not springs and (features.measures_areas or at is in_tile):
        around = ring_loop(features, at, inflation_directions)
    else:
        pull_of_springs = springs or spring_loop(features, at)
        around = one_after_the_other(features, pull_of_springs, area_vector or own_area_vector, vertex_normal)
    return Loops(
        around,
        other_pulls if others else None,
        own_water_load,
        features.laws_added("particle"),
    )


@wp.func
def is_self(end: wp.int32, own: wp.int32, lane: wp.int32):
    """Return whether a spring leads from a particle to itself."""
    return end == own


@wp.func
def is_self(end: Any, own: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """Return whether a spring leads from a particle of an octet to itself."""
    return end[lane] == LANE_COUNT * own + lane


@cache
def spring_loop_of_eight(features: Features, at: Any) -> Any:
    """Return the function that sums the springs of eight particles."""
    coefficient_in_lane = features.laws_in_lane_on("spring")
    moving = features.needs("spring", "opening")

    @wp.func
    def pull_of_springs(
        t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Lanes3, velocity: Lanes3, time: float
    ):
        """Return the net force of the springs [N]."""
        force = Lanes3()
        for entry in range(t.spring_offsets[params.number], t.spring_offsets[params.number + 1]):
            end = entry_at(t.spring_ends, entry)
            length = entry_at(t.spring_lengths, entry)
            constants = entry_at(params.n, entry_at(t.spring_kinds, entry))
            d = at(points, end) - point
            squared = squared_length(d)
            opening = Lanes()
            if wp.static(moving):
                opening = dot_product(at(velocities, end) - velocity, d)
            coefficients = Lanes()
            for lane in range(LANE_COUNT):
                stiffness = constants[lane]
                if wp.static(features.springs_vary):
                    stiffness *= of_lane(t.spring_scales[entry], lane)
                coefficients[lane] = coefficient_in_lane(
                    squared[lane], opening[lane], of_lane(length, lane), stiffness,
                    stiffness * of_lane(length, lane), t.step_seconds, time, params.n, lane,
                )  # fmt: skip
                if wp.static(features.guarded):
                    coefficients[lane] = wp.where(is_self(end, params.number, lane), 0.0, coefficients[lane])
            force = plus_scaled(force, d, coefficients)
        return force

    return pull_of_springs


@cache
def area_loop_of_eight(features: Features, at: Any) -> Any:
    """Return the function that sums the area vectors of eight particles."""
    area_vector_in_faces = area_loop(False, at)

    @wp.func
    def area_vector(t: Any, points: Any, params: Any, springs: Any, point: Lanes3):
        """Return the area vectors of eight particles [m^2]."""
        if wp.static(not features.quads):
            return area_vector_in_faces(t.fans, points, params.number, point)
        else:
            total = Lanes3()
            for entry in range(t.fans.offsets[params.number], t.fans.offsets[params.number + 1]):
                begin = int_at(t.fans.begins, entry)
                total += cross_at_quad_corner(
                    at(points, entry_at(t.fans.particles, begin + 2)) - point,
                    at(points, entry_at(t.fans.particles, begin + 1)) - point,
                    at(points, entry_at(t.fans.particles, begin)) - point,
                )
            return scaled(total, CROSSES)

    return area_vector


@cache
def laws_of_eight(features: Features) -> Any:
    """Return the function that adds the laws on particles."""
    laws_in_lane = features.laws_in_lane_on("particle")

    @wp.func
    def particle_laws(
        so_far: Lanes3,
        position: Lanes3,
        velocity: Lanes3,
        mass: Lanes,
        mass_share: Any,
        area_vector: Lanes3,
        water_load: Any,
        up: wp.vec3,
        step_seconds: float,
        time: float,
        n: wp.array[Lanes],
    ):
        """Return the force with that of the laws on particles [N]."""
        force = Lanes3()
        for lane in range(LANE_COUNT):
            of_one = laws_in_lane(
                position, velocity, mass, mass_share, area_vector, water_load, up, step_seconds, time, n, lane
            )
            force[0, lane] = of_one[0]
            force[1, lane] = of_one[1]
            force[2, lane] = of_one[2]
        return so_far + force

    return particle_laws


@cache
def loops_of_eight(features: Features, at: Any, take: Any, view_of: Any, params_of_one: Any) -> Loops:
    """Return the loops for eight particles at a time.

    Args:
        at: the function that reads eight points, or of a view of one world one.
        take: the one that takes the sums of hinges and membranes.
        view_of: the one that gives a lane's view of the points.
        params_of_one: the one that gives the parameters of the particle in a lane.
    """
    sum_strings = string_loop(features) if features.has("string") else None
    load_of_particle = ring_wetness_loop(at) if features.rings else wetness_loop(at)
    level = features.columns.places.get("water_level", 0)

    @wp.func
    def pulls_on_one(t: Any, points: Any, velocities: Any, one: Any, point: wp.vec3, velocity: wp.vec3, time: float):
        """Return the forces of strings on one of eight particles [N]."""
        return sum_strings(t.all.strings, one.world, one.number, point, velocity, one.n, t.step_seconds, time)

    @wp.func
    def pulls_one_by_one(
        t: Any, points: Any, velocities: Any, params: Any, point: Lanes3, velocity: Lanes3, time: float
    ):
        """Return the forces of strings on eight particles, one by one [N]."""
        pulls = Lanes3()
        for lane in range(t.lane_count):
            pull = pulls_on_one(
                t, view_of(points, lane, t.places), view_of(velocities, lane, t.places), params_of_one(t, params, lane),
                of_lane(point, lane), of_lane(velocity, lane), time,
            )  # fmt: skip
            pulls = set_lane(pulls, lane, pull)
        return pulls

    @wp.func
    def other_pulls(t: Any, points: Any, velocities: Any, params: Any, point: Lanes3, velocity: Lanes3, time: float):
        """Take the net force of strings, and the sums of hinges, faces and membranes [N], which are cleared."""
        force = Lanes3()
        if wp.static(bool(features.membranes) or features.has("hinge") or features.has("face")):
            force += take(t, params)
        if wp.static(sum_strings is not None):
            if t.held[params.number] > 0:
                force += pulls_one_by_one(t, points, velocities, params, point, velocity, time)
        return force

    @wp.func
    def water_load(t: Any, points: Any, params: Any):
        """Return depth times area vector [m^3], and wetted area [m^2]."""
        loads = Lanes4()
        levels = params.n[level]
        for lane in range(t.lane_count):
            one = params_of_one(t, params, lane)
            view = view_of(points, lane, t.places)
            load = wp.vec4()
            if wp.static(features.rings):
                load = load_of_particle(t.all.rings, view, one.number, levels[lane], t.up)
            else:
                load = load_of_particle(t.all.faces, view, one.number, levels[lane], t.up)
            loads = set_lane(loads, lane, load)
        return loads

    around = one_after_the_other(features, spring_loop_of_eight(features, at), area_loop_of_eight(features, at))
    return Loops(around, other_pulls, water_load, laws_of_eight(features))
