"""One world as octets: eight of its particles, or faces, side by side."""

import warp as wp

from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, set_column
from balloon_warp.kernels.motion import lift, response
from balloon_warp.kernels.tables import (
    BodyTable,
    WorldState,
    particle_damping,
    particle_mass,
    row_of_world,
)

LaneNumbers = wp.types.vector(length=8, dtype=wp.int32)
"""the number of a particle or a face in each of eight lanes"""

# What an octet has in `OctetState.numbers`: a number for each of its particles.
RESPONSE = wp.constant(3)  # 0, 1 and 2 are the spring constants of the kinds
LIFT = wp.constant(4)
DRAG = wp.constant(5)
RAMP_BEGIN = wp.constant(6)
RAMP_SLOPE = wp.constant(7)
OCTET_NUMBERS = 8


@wp.struct
class OctetSprings:
    """The springs of eight particles at a time, each spring so twice. Those of octet o, `offsets[o]` to
    `offsets[o + 1]`, are of one kind each; a particle with fewer than the others has springs to itself, which do
    nothing."""

    offsets: wp.array[wp.int32]
    kinds: wp.array[wp.int32]
    ends: wp.array[LaneNumbers]
    """the particles at the other ends"""
    scales: wp.array[Lanes]
    """a spring's constant over that of its kind; empty if all are 1"""
    rest_lengths: wp.array[Lanes]
    """times the scale [m]"""
    stiffness: wp.array3d[float]


@wp.struct
class OctetFaces:
    """Eight faces at a time, of one balloon and with as many corners; what fills up the last is a face without area."""

    offsets: wp.array[wp.int32]
    """where each octet's corners begin in `corners`, and after the last, where they end"""
    corners: wp.array[LaneNumbers]
    counting: wp.array[wp.int32]
    """0, 1, 2 and so on, for as many corners as a face has"""
    balloon: wp.array[wp.int32]
    """of each octet"""
    around_offsets: wp.array[wp.int32]
    """where the faces around each octet of particles begin in `around`, and after the last, where they end"""
    around: wp.array[LaneNumbers]
    """what fills up is a face far away without area, the last"""


@wp.struct
class OctetState:
    """Working memory, a row for each world. Particles and faces stand in whole octets.

    Points and the like are four numbers, of which the last is not used, so that one load fetches a point.
    """

    points: wp.array2d[wp.vec4]
    other_points: wp.array2d[wp.vec4]
    velocities: wp.array2d[Lanes3]
    aims: wp.array2d[Lanes3]
    numbers: wp.array3d[Lanes]
    corner_points: wp.array2d[Lanes3]
    face_centers: wp.array2d[wp.vec4]
    face_area_vectors: wp.array2d[wp.vec4]
    balloon_areas: wp.array2d[Lanes]


@wp.func
def whole_octet(octet: wp.int32):
    """The numbers of its particles or faces."""
    numbers = LaneNumbers()
    for lane in range(LANE_COUNT):
        numbers[lane] = LANE_COUNT * octet + lane
    return numbers


@wp.func_native(
    """
    typedef float four __attribute__((ext_vector_type(4)));
    typedef float eight __attribute__((ext_vector_type(8)));
    four v[8];
    for (int lane = 0; lane < 8; ++lane)
        __builtin_memcpy(&v[lane], &vectors.data[numbers[lane]], sizeof(four));
    wp::mat_t<3, 8, float> lanes;
    for (int axis = 0; axis < 3; ++axis) {
        eight row = {v[0][axis], v[1][axis], v[2][axis], v[3][axis], v[4][axis], v[5][axis], v[6][axis], v[7][axis]};
        __builtin_memcpy(lanes.data[axis], &row, sizeof(eight));
    }
    return lanes;
    """
)
def fetch(vectors: wp.array[wp.vec4], numbers: LaneNumbers) -> Lanes3:
    """Eight vectors, from wherever they stand, into lanes.

    Written for the compiler of CPU kernels, which makes eight loads and a few shuffles of it; of the like in Python it
    makes a load for each number, and a multiplication for each address.
    """
    ...


@wp.func
def store(vectors: wp.array[wp.vec4], octet: wp.int32, lanes: Lanes3):
    """Eight vectors out of the lanes, to where an octet's stand."""
    for lane in range(LANE_COUNT):
        vectors[LANE_COUNT * octet + lane] = wp.vec4(lanes[0, lane], lanes[1, lane], lanes[2, lane], 0.0)


@wp.func
def set_number(numbers: wp.array[Lanes], which: wp.int32, lane: wp.int32, value: float):
    """Of one particle of an octet."""
    numbers[which][lane] = value


@wp.func
def read_octets(
    bodies: BodyTable,
    springs: OctetSprings,
    step_seconds: float,
    state: WorldState,
    octets: OctetState,
    world: wp.int32,
):
    """Into the octets, what a frame begins with. What fills up the last octet has no mass and stays where it is."""
    gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
    for particle in range(state.points.shape[1]):
        octet = particle // LANE_COUNT
        lane = particle % LANE_COUNT
        balloon = bodies.balloon[particle]
        point = state.points[world, particle]
        octets.points[world, particle] = wp.vec4(point[0], point[1], point[2], 0.0)
        octets.velocities[world, octet] = set_column(
            octets.velocities[world, octet], lane, state.velocities[world, particle]
        )
        octets.aims[world, octet] = set_column(octets.aims[world, octet], lane, state.inflation_aims[world, particle])
        numbers = octets.numbers[world, octet]
        row = row_of_world(world, springs.stiffness.shape[0])
        set_number(numbers, 0, lane, springs.stiffness[row, balloon, 0])
        set_number(numbers, 1, lane, springs.stiffness[row, balloon, 1])
        set_number(numbers, 2, lane, springs.stiffness[row, balloon, 2])
        mass = particle_mass(bodies, world, particle)
        helium = bodies.helium[row_of_world(world, bodies.helium.shape[0]), balloon]
        set_number(numbers, RESPONSE, lane, response(mass, step_seconds))
        set_number(numbers, LIFT, lane, lift(mass, gravity, helium))
        set_number(numbers, DRAG, lane, particle_damping(bodies, world, particle))
        ramp = state.inflation_ramp[world, balloon]
        set_number(numbers, RAMP_BEGIN, lane, ramp[0])
        set_number(numbers, RAMP_SLOPE, lane, ramp[1])


@wp.func
def write_octets(state: WorldState, octets: OctetState, points: wp.array[wp.vec4], world: wp.int32):
    """Out of the octets, what a frame ends with."""
    for particle in range(state.points.shape[1]):
        octet = particle // LANE_COUNT
        lane = particle % LANE_COUNT
        point = points[particle]
        state.points[world, particle] = wp.vec3(point[0], point[1], point[2])
        state.velocities[world, particle] = column(octets.velocities[world, octet], lane)
        state.inflation_aims[world, particle] = column(octets.aims[world, octet], lane)
