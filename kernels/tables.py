"""Tables of the model, as kernels read it: indexed by particle.

Schedules fill these; see `balloon_warp.model.Model` for the shapes of arrays named alike there.
"""

import warp as wp

from balloon_warp.kernels.contact_tables import BodyTable, FixtureTable, RidgeTable, SphereTable, TouchTable
from balloon_warp.kernels.gas_tables import NeckTable, PumpTable, TubeTable
from balloon_warp.kernels.measure.health import HealthTable
from balloon_warp.kernels.membrane_face_tables import MembraneFaceTable
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.outer_tables import ForceTable, StringTable
from balloon_warp.kernels.wear_tables import WearTable

SLICE = wp.constant(32)
"""Particles in a slice of the tables of springs and of quads: the threads of a warp"""
CHUNK = wp.constant(4)
"""Number of springs that a particle loads together"""


@wp.struct
class ParticleTable:
    """Particles, and which balloon each belongs to."""

    balloon: wp.array[wp.int32]
    mass_share: wp.array[float]
    offsets: wp.array[wp.int32]
    """Begin of each balloon's particles, and the end of the last"""


@wp.struct
class SpringTable:
    """The springs of each particle, each spring so twice.

    In slices of 32 particles, the threads of a warp: spring `slot` of particle p stands at
    `slice_offsets[p // 32] + 32 * slot + p % 32`, so that 32 threads load 32 neighbors. A particle's slots are filled
    up to a multiple of four with springs that do nothing.
    """

    slice_offsets: wp.array[wp.int32]
    valences: wp.array[wp.int32]
    """Number of springs of each particle"""
    entries: wp.array[wp.vec2]
    """Four times the particle at the other end, plus the spring's kind, as the bits of an integer; rest length [m]"""
    scales: wp.array[float]
    """Spring constants over those of their kinds; empty if all are 1"""


@wp.struct
class RingTable:
    """Springs of each particle where quads go all around every one of them.

    First the quads in turn, each with the spring across it and the structural spring that ends it, then the flexion
    springs, two at a time. In slices of 32 particles: a particle's next entry is `SLICE` further.
    """

    places: wp.array[wp.vec4i]
    """First entry, number of quads, number of pairs of flexion springs, and the particle at the end of the structural
    spring that the first quad begins with, by particle"""
    ends: wp.array[wp.vec2i]
    """Particles at the other ends of two springs; padding leads to the particle itself"""
    packed_ends: wp.array[wp.int32]
    """`ends` in 16 bits each, for worlds that fit in a block, where bytes bound the rate; one of both is empty"""
    lengths: wp.array[wp.vec2]
    """Rest lengths of the two springs [m]"""
    scales: wp.array[wp.vec2]
    """Constants of the two springs over those of their kinds; empty if all are 1"""


@wp.struct
class PairTable:
    """The springs, each once."""

    particles: wp.array[wp.vec2i]
    kinds: wp.array[wp.int32]
    scales: wp.array[float]
    rest_lengths: wp.array[float]
    """Rest lengths [m]"""


@wp.struct
class HingeTable:
    """The edges between two faces, and the roles of each particle in them; empty without torsion springs."""

    ends: wp.array[wp.vec2i]
    wing_offsets: wp.array[wp.int32]
    """Begin of the corners of hinge n's wings: entries 2 n and 2 n + 1"""
    wing_particles: wp.array[wp.int32]
    rest_angles: wp.array[float]
    """Rest angles [rad]"""
    particle_offsets: wp.array[wp.int32]
    """Begin of each particle's roles, and the end of the last"""
    particle_roles: wp.array[wp.int32]
    """Four times the hinge, plus the particle's role in it"""


@wp.struct
class MembraneTable:
    """The triangles of membranes, each once, and from each of their corners; empty where all balloons are springs.

    Four numbers describe a triangle at rest: components 11, 12 and 22 of the inverse of the products of its edges d1
    and d2 from its first corner [1/m^2], and its area [m^2] times its part of the face's cover, times its thickness
    over that of its balloon.
    """

    corners: wp.array[wp.vec3i]
    corner_rests: wp.array[wp.vec4]
    materials: wp.array[wp.int32]
    """Number of each balloon's membrane law"""
    slice_offsets: wp.array[wp.int32]
    """Slices as for springs: a particle's next triangle is `SLICE` further"""
    counts: wp.array[wp.int32]
    """Number of triangles of each particle"""
    others: wp.array[wp.vec2i]
    """Other two corners of each triangle"""
    rests: wp.array[wp.vec4]
    """Rest metrics, with the particle as the first corner"""
    membrane_faces: MembraneFaceTable
    wear: WearTable


@wp.struct
class FaceTable:
    """Faces, and the faces around each particle."""

    offsets: wp.array[wp.int32]
    particles: wp.array[wp.int32]
    balloon: wp.array[wp.int32]
    balloon_offsets: wp.array[wp.int32]
    """Begin of each balloon's faces, and the end of the last"""
    volume_origins: wp.array[wp.int32]
    """Particle of each balloon about which its volume is summed: one of a face"""
    enclosed: wp.array[wp.vec2]
    """Volume of each balloon's mesh [m^3], and the largest gauge pressure of a gas in it, over the balloon's mass and
    times the step squared [1/m]"""
    particle_offsets: wp.array[wp.int32]
    around_particles: wp.array[wp.int32]


@wp.struct
class FanTable:
    """The corners of the faces at each particle, each seen from there.

    Where all faces are quads, in slices as springs are: the corner before, the one opposite, the one after. Padding is
    a quad of the particle alone, without area. Other faces: all other corners of each, in order.
    """

    slice_offsets: wp.array[wp.int32]
    counts: wp.array[wp.int32]
    """Number of corners at each particle"""
    quads: wp.array[wp.vec3i]
    offsets: wp.array[wp.int32]
    """Begin of each particle's corners in `begins`; empty where all faces are quads, as are the next two"""
    begins: wp.array[wp.int32]
    """Begin of the other particles of each corner, and the end of the last"""
    particles: wp.array[wp.int32]


@wp.struct
class CorrectionTable:
    """The springs as the position correction takes them: color by color, no two of one color at one particle."""

    color_offsets: wp.array[wp.int32]
    """Begin of the springs of each color, and the end of the last"""
    particles: wp.array[wp.vec2i]
    rest_lengths: wp.array[float]
    """Rest lengths [m]"""
    sweeps: wp.int32


@wp.struct
class Tables:
    """Tables that do not change in a frame.

    At most 8 KiB: of a larger struct NVIDIA's compiler leaves copies in local memory wherever a function takes it, and
    a kernel takes it minutes instead of seconds.
    """

    particles: ParticleTable
    springs: SpringTable
    rings: RingTable
    pairs: PairTable
    hinges: HingeTable
    membranes: MembraneTable
    strings: StringTable
    outer: ForceTable
    faces: FaceTable
    fans: FanTable
    spheres: SphereTable
    fixtures: FixtureTable
    bodies: BodyTable
    tubes: TubeTable
    pumps: PumpTable
    necks: NeckTable
    touch: TouchTable
    ridges: RidgeTable
    correction: CorrectionTable
    health: HealthTable
    balloon_numbers: wp.array3d[float]
    """Parameters of balloons, shape (W, balloon_count, width), see `laws.columns`"""
    world_numbers: wp.array2d[float]
    """Parameters of worlds, shape (W, width)"""
    friction: wp.array3d[float]
    """Coulomb friction coefficients, shape (W, thing_count, thing_count), see `loops.friction`"""
    inflation_kind: wp.array[wp.int32]
    up: wp.vec3
    substeps: wp.int32
    step_seconds: float
    frame_seconds: float


@wp.struct
class WorldState:
    """The arrays of `balloon_warp.model.State`, which a schedule reads a frame from and writes it to."""

    frame: wp.array[wp.int32]
    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    inflation_ramp: wp.array2d[wp.vec2]
    inflation_loads: wp.array2d[wp.vec2]
    pressures: wp.array2d[float]
    pressure_slopes: wp.array2d[float]
    gas_amounts: wp.array2d[wp.float64]
    free_volumes: wp.array2d[wp.float64]
    air_along: wp.array2d[float]
    airs: wp.array2d[wp.vec3]
    tube_flows: wp.array2d[float]
    vent_flows: wp.array2d[float]
    thrusts: wp.array2d[float]
    holds: wp.array2d[wp.vec4]
    deep: wp.array2d[wp.int8]
    bursts: wp.array2d[wp.vec4]
    torn: wp.array2d[float]
    tear_planes: wp.array2d[wp.vec4]
    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_spins: wp.array2d[wp.vec3]
    sphere_forces: wp.array2d[wp.vec3]
    body_positions: wp.array2d[wp.vec3]
    body_turns: wp.array2d[wp.quat]
    body_velocities: wp.array2d[wp.vec3]
    body_momenta: wp.array2d[wp.vec3]
    body_touches: wp.array2d[wp.int32]
    body_impulses: wp.array2d[wp.vec3d]
    first_bad: wp.array[wp.int32]


@wp.func
def row_of_world(world: wp.int32, rows: wp.int32):
    """Return `world % rows` for a parameter with one row, or one for each world, without a division."""
    return wp.where(rows == 1, 0, world)


@wp.func
def is_chosen(mask: wp.array[wp.int32], world: wp.int32):
    """Return whether a mask chooses a world; one without entries chooses all."""
    chosen = True
    if mask.shape[0] > 0:
        chosen = mask[world] != 0
    return chosen


@wp.func
def first_entry(slice_offsets: wp.array[wp.int32], particle: wp.int32):
    """Return the index of a particle's first spring or quad; the next is `SLICE` further."""
    return int_at(slice_offsets, particle >> 5) + (particle & 31)


@wp.func
def sphere_number(spheres: SphereTable, world: wp.int32, sphere: wp.int32, column: wp.int32):
    """Return a number of a sphere by its column, see `laws.columns`."""
    return spheres.numbers[row_of_world(world, spheres.numbers.shape[0]), sphere, column]


@wp.func
def sphere_mass(spheres: SphereTable, world: wp.int32, sphere: wp.int32):
    """Return the mass of a sphere [kg]."""
    return sphere_number(spheres, world, sphere, 0)


@wp.func
def sphere_radius(spheres: SphereTable, world: wp.int32, sphere: wp.int32):
    """Return the radius of a sphere [m]."""
    return sphere_number(spheres, world, sphere, 1)


@wp.func
def sphere_penalty(spheres: SphereTable, world: wp.int32, sphere: wp.int32):
    """Force on it, over the inflation of a particle that touches."""
    return sphere_number(spheres, world, sphere, 2)


@wp.func
def sphere_restitution(spheres: SphereTable, world: wp.int32, sphere: wp.int32):
    """Return a sphere's coefficient of restitution, against an equal one."""
    return sphere_number(spheres, world, sphere, 3)
