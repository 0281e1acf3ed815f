"""Tables of the model, as kernels read it: particles, faces, gas, membranes, strings, contact, limits of health.

Schedules fill these; see `balloon_warp.model.Model` for the shapes of arrays named alike there. At the end stand the
names of state that balloons, spheres, bodies and other items have beside their particles. A phase reaches it by the
handles `state`, `working`, `spheres` and `t`. Its source says which it reads and changes, see `kernels.phase`; what
follows from that is found there: whether the gas is constant over a frame, whether spheres are pushed, where a barrier
stands. An array that no name has is not to be written.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.laws.touch import Ridge
from balloon_warp.kernels.memory import int_at

HEALTHY = 2**31 - 1
"""Marker: no particle or sphere of a world is bad"""


@wp.struct
class HealthTable:
    """Limits of distance, squared [m^2]."""

    near: float
    """Distance from the world's origin within which nothing is bad"""
    reach: float
    """Limit of the distance from the world's origin"""
    spans: wp.array[float]
    """Limit of the distance between two particles of a balloon"""
    origins: wp.array[wp.int32]
    """Particle of each balloon from which the others' distances are measured"""
    partners: wp.array[wp.int32]
    """Particle from which the distance of that particle is measured"""


@wp.func
def is_past(vector: wp.vec3, squared_limit: float):
    """Return whether a vector is longer than a limit, or not finite.

    As unsigned integers, NaN and infinities exceed every float; compilers that assume finite numbers leave this alone.
    """
    return wp.cast(wp.length_sq(vector), wp.uint32) > wp.cast(squared_limit, wp.uint32)


@wp.func
def check_particle(
    health: HealthTable,
    first_bad: wp.array[wp.int32],
    world: wp.int32,
    particle: wp.int32,
    number: wp.int32,
    balloon: wp.int32,
    mass_share: float,
    points: Any,
):
    """Lower the world's entry to the particle's number in the model if the particle is bad.

    It is bad if it is too far from its balloon's origin, or is that origin and too far from the world's or from its
    partner. Most particles are near, which takes no memory to see. A particle without mass stays where it is.
    """
    point = points[particle]
    if is_past(point, health.near):
        if mass_share > 0.0:
            other = health.origins[balloon]
            bad = bool(False)
            if particle == other:
                other = health.partners[balloon]
                bad = is_past(point, health.reach)
            if bad or is_past(point - points[other], health.spans[balloon]):
                wp.atomic_min(first_bad, world, number)


@wp.func
def check_sphere(
    health: HealthTable,
    first_bad: wp.array[wp.int32],
    world: wp.int32,
    particle_count: wp.int32,
    sphere: wp.int32,
    position: wp.vec3,
):
    """Lower the world's entry to the sphere, numbered after the particles, if that is bad."""
    if is_past(position, health.reach):
        wp.atomic_min(first_bad, world, particle_count + sphere)


@wp.struct
class SphereTable:
    """Spheres with which particles collide."""

    numbers: wp.array3d[float]
    """Parameters of spheres, shape (W, sphere_count, width), see `kernels.laws.Columns`"""
    small: wp.array[wp.int32]
    """Whether each sphere is so small that it also touches faces; empty where none is"""
    triangles: wp.array[wp.vec3i]
    """Particles of each triangle that small spheres may touch; empty where no sphere is small"""


@wp.struct
class Solid:
    """A shape as a signed distance, see `laws.contact`."""

    kind: wp.int32
    size: wp.vec3
    """Half the edges of a box; radius and half the length of a capsule [m]"""
    mesh: wp.uint64
    closed: wp.int32
    thickness: float
    """Distance from the surface at which particles are held [m]"""
    reach: float
    """Distance of the farthest point from the origin [m]"""
    blur: float
    """Resolution of float32 between distances from a point to two places of a mesh, over the mesh's mean edge"""


@wp.struct
class FixtureTable:
    """Obstacles with prescribed motion."""

    solids: wp.array[Solid]
    motion: wp.array2d[wp.transform]
    """Shift from its position, and rotation, as the frame begins, and then as it ends, shape (2 W, N), or (1, N) if
    all rest"""
    positions: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    """Velocities that are written on the device, in addition to `motion` [m/s]; empty where none are"""
    restitutions: wp.array2d[float]
    """Coefficients of restitution with spheres"""
    samples: wp.array[wp.vec4]
    """Centers of balls inside obstacles that free bodies are held out of [m], and their radii [m]; empty where there
    are none"""
    sample_ends: wp.array[wp.vec2i]
    """Begin and end of each obstacle's samples"""
    fastest: float
    """Largest speed of a point of any obstacle [m/s]"""
    clearances: wp.array2d[wp.vec4]
    """Cache, by world and particle: position at the last query, and the clearance then plus the distance that `fastest`
    covers until then [m]; 0 at the start of a frame"""
    nearest: wp.array2d[wp.vec2]
    """Cache beside it: the nearest obstacle, and the clearance from all others [m]; empty if there is one"""


@wp.struct
class BodyTable:
    """Free rigid bodies about their centers of mass, see `loops.bodies`; empty where there are none."""

    solids: wp.array[Solid]
    mass: wp.array2d[float]
    restitution: wp.array2d[float]
    inertias: wp.array[wp.mat33]
    """Inertia tensors of 1 kg, about the center of mass [m^2]"""
    inverse_inertias: wp.array[wp.mat33]
    """Inverses of the inertia tensors of 1 kg [1/m^2]"""
    samples: wp.array[wp.vec4]
    """Centers of balls inside bodies that are held out of other solids [m], and their radii [m]"""
    sample_ends: wp.array[wp.vec4i]
    """Begin of each body's samples, and the ends of those that count on the ground, at bodies, and at obstacles"""


@wp.struct
class TouchTable:
    """Surfaces as triangles, in leaves of a few that lie together, for balloons that touch; empty where none do.

    Leaves that follow each other lie together, too: their order is that of a tree.
    """

    triangles: wp.array[wp.vec3i]
    """Particles of each triangle, counter-clockwise from outside"""
    leaves: wp.array[wp.vec4i]
    """Begin and end of each leaf's triangles, and of its edges that touch others"""
    balloon_leaves: wp.array[wp.int32]
    """First leaf of each balloon, and the end of the last"""
    particles: wp.array[wp.int32]
    """Particles of the leaves, each once in a leaf"""
    leaf_particles: wp.array[wp.vec2i]
    """Begin and end of each leaf's particles"""
    rest_boxes: wp.array2d[wp.vec3]
    """Boxes of leaves at the start: lower and upper corner [m]; empty unless balloons touch themselves"""
    closed: wp.array[wp.int32]
    """Whether each balloon has an inside, out of which others are pushed"""
    thickness: wp.array[float]
    """Skin thickness of each balloon, where the scene gives none [m]"""
    slack: wp.array[float]
    """Distance that particles of each balloon may gain on each other by accelerating between two searches [m]"""
    depth: wp.array[float]
    """Depth in each balloon down to which particles inside are pushed out the nearest way [m]"""
    crowd: wp.array[float]
    """Contacts on a particle of each balloon that the step allows for"""
    stiffness: wp.array2d[float]
    """Contact stiffness of each balloon, where the scene gives none [N/m]"""
    rest_points: wp.array[wp.vec3]
    """Positions of particles at the start [m]; empty unless balloons touch themselves"""
    apart: wp.array[float]
    """Distance from a triangle of the same balloon at the start above which a particle may touch it, by balloon [m]; of
    one that is folded then, a particle may touch all triangles but its own"""
    seconds: float
    """Time between two searches [s]"""
    homes: wp.array[wp.vec2i]
    """Particles, leaf by leaf, and the leaf of a triangle of each; the balloon's first where it has none"""
    edges: wp.array[wp.vec2i]
    """Particles of the edges that touch others, leaf by leaf; empty where none do"""
    edge_homes: wp.array[wp.int32]
    """Leaf of each edge"""


@wp.struct
class RidgeTable:
    """Ridges of all solids: obstacles, then free bodies, then spheres; empty where faces do not meet them.

    A sphere's ridge is its center.
    """

    ridges: wp.array[Ridge]
    ends: wp.array[wp.vec2i]
    """Begin and end of each solid's ridges"""
    boxes: wp.array2d[wp.vec3]
    """Lower and upper corner of the box around the ridges of each solid, relative to it [m]"""
    trees: wp.array[wp.uint64]
    """Bounding volume trees of the ridges of each solid; 0 for a solid without ridges"""
    features: wp.array[wp.vec4i]
    """Triangles and edges of balloons: their particles, -1 in place of an edge's third, and their balloon"""
    kept: float
    """Distance that faces keep from ridges [m]"""
    margin: float
    """Additional distance within which ridges are recorded [m]"""


@wp.struct
class TubeTable:
    """Tubes between balloons."""

    balloons: wp.array[wp.vec2i]
    conductance: wp.array2d[float]


@wp.struct
class PumpTable:
    """The curves of pumps; a shorter one repeats its last point."""

    has: wp.array[wp.int32]
    """Whether each balloon has a pump curve"""
    pressures: wp.array2d[float]
    """Pressures of the curve's points [Pa], shape (balloon_count, points)"""
    flows: wp.array2d[float]
    """Flows of the curve's points [mol/s]"""


@wp.struct
class NeckTable:
    """Necks of balloons; empty unless a balloon is open."""

    weights: wp.array[float]
    """Share of each particle in the thrust of its balloon's neck: by mass, 0 away from the neck"""
    offsets: wp.array[wp.int32]
    """Begin of the edges around each balloon's neck, and the end of the last"""
    edges: wp.array[wp.vec2i]
    """Edges around the neck, in the order of the faces that would close it"""


@wp.struct
class MembraneFaceTable:
    """Triangles of membranes, by faces of four corners with four triangles, or one, as a block loops over them.

    A face of one triangle has its first corner twice. Empty where no block loops over faces.
    """

    corners: wp.array[wp.vec4i]
    """Particles at each face's corners; where forces are in tiles, byte offsets of the particles' points"""
    rests: wp.array[wp.vec4]
    """Rest metric of the triangle at each corner, all of the first corners first; no area where there is no triangle"""
    sums: wp.array[wp.vec4]
    """Rest sums where threads keep quads: of each along its edges, then of each the roots, then across and the slopes;
    see `Sums`, with a k of 1"""
    balloons: wp.array[wp.int32]
    """Balloon of each face"""
    numbers: wp.array[wp.vec4i]
    """Numbers of the triangles, where membranes wear"""
    places: wp.array[wp.vec4i]
    """Addresses of each face's forces on its particles, corner times the number of faces plus the face, in fours: the
    first four of all particles, then the next; an address past the end as padding; in tiles times `PLACE_BYTES`"""


@wp.struct
class StringTable:
    """Strings sorted by the particle that they hold: those of p are `offsets[p]` to `offsets[p + 1]`."""

    offsets: wp.array[wp.int32]
    """Begin of each particle's strings; empty if there are no strings"""
    particles: wp.array[wp.int32]
    """Particle that each string holds, in order"""
    order: wp.array[wp.vec2i]
    """Index of the string in the model, and of the free body that carries its anchor, or -1"""
    anchors: wp.array2d[wp.vec3]
    """Anchors. Where any moves: as the frame begins, on a body as the substep does; their velocities over the frame, on
    a body 0; and in the axes of a body from its center of mass, by turns, shape (3 world_count, string_count + 1),
    where the last column has the time at which the frame begins"""
    lengths: wp.array2d[float]
    stiffness: wp.array2d[float]


@wp.struct
class ForceTable:
    """Outer forces on each particle."""

    slots: wp.array2d[float]
    """Share of a particle in a force, and the index of that force, by turns; padded by shares of 0. Shape
    (particle_count, 2 times the most forces on any), or (0, 0) if none acts"""
    newtons: wp.array2d[wp.vec3]


@wp.struct
class TearTable:
    """Tearing of membranes, some of it found by world in a substep; empty where none may tear."""

    triangle_offsets: wp.array[wp.int32]
    """Begin of each face's triangles in `triangles`, and the end of the last"""
    triangles: wp.array[wp.int32]
    neighbor_offsets: wp.array[wp.int32]
    """Begin of the neighbors of each face, which share an edge with it"""
    neighbors: wp.array[wp.int32]
    edges: wp.array[wp.vec2i]
    """Edge shared with each neighbor, by its particles"""
    rests: wp.array[wp.vec3]
    """Positions of particles on the unstretched skin [m]"""
    centers: wp.array[wp.vec3]
    """Centers of faces on the unstretched skin [m]"""
    normals: wp.array[wp.vec3]
    """Unit normals of faces on the unstretched skin"""
    ways: wp.array[float]
    """Distance after which a tear branches, and again, by balloon [m]"""
    branchings: wp.array[wp.int32]
    """Number of branchings, by balloon; the start of a tear is the first"""
    film_strength: wp.array2d[float]
    """Strength of balloons, see `laws.membrane`, shape (W, balloon_count), as are the next four"""
    tear_strength: wp.array2d[float]
    branching_stress: wp.array2d[float]
    tear_speed: wp.array2d[float]
    needle_time: wp.array2d[float]
    stresses: wp.array2d[float]
    """Larger principal true stress of each triangle [Pa]"""
    gone: wp.array2d[wp.int8]
    """1 of each face that is torn"""
    face_stresses: wp.array2d[float]
    """Mean stress of each face's triangles [Pa]"""
    ahead: wp.array2d[float]
    """Distance of the tear beyond each face that tears in this substep [m], negative for others"""
    areas: wp.array3d[wp.int64]
    """Areas of balloons that burst, of torn faces and of the others, in square micrometers, whose integer sums do not
    depend on the order"""
    weakest: wp.array2d[wp.int64]
    """Face and stress where each balloon is to burst, see `balloon_warp.schedules.membranes`"""


@wp.struct
class WearTable:
    """Wear of membranes that soften or may tear; empty where none does."""

    left: wp.array2d[float]
    """Factor on the tension of each triangle in this substep, shape (world_count, triangle_count)"""
    numbers: wp.array[wp.int32]
    """Triangle of each entry of `MembraneTable.others`"""
    softening: wp.array2d[float]
    """Softening of balloons, see `laws.membrane`, shape (W, balloon_count), as are the next two"""
    softening_energy: wp.array2d[float]
    softening_share: wp.array2d[float]
    tears: TearTable


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
    """Parameters of balloons, shape (W, balloon_count, width), see `kernels.laws.Columns`"""
    world_numbers: wp.array2d[float]
    """Parameters of worlds, shape (W, width)"""
    friction: wp.array3d[float]
    """Coulomb friction coefficients, shape (W, thing_count, thing_count), see `loops.fixtures`"""
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
    """Return a number of a sphere by its column, see `kernels.laws.Columns`."""
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


class Named(NamedTuple):
    """A part of the state: the item that has it, its meaning, and its arrays."""

    item: str
    meaning: str
    arrays: tuple[str, ...]


GAS, SPHERE_PUSH, BODY_PUSH = "gas", "sphere_push", "body_push"
NAMED: dict[str, Named] = {
    GAS: Named("balloon", "amount of gas, and its free volume", ("gas_amounts", "free_volumes")),
    "gas_mass": Named("balloon", "mass of the gas, and of the air that moves along", ("gas_masses",)),
    "pressure": Named("balloon", "pressure, and how it changes", ("pressures", "pressure_slopes", "inflation_loads")),
    "flow": Named("balloon", "flow of gas, and its thrust", ("tube_flows", "vent_flows", "thrusts")),
    "sphere": Named("sphere", "course", ("sphere_positions", "sphere_velocities", "sphere_spins", "sphere_starts")),
    SPHERE_PUSH: Named("sphere", "sum of forces since it last moved, see `add_quanta`", ("sphere_quanta",)),
    "sphere_force": Named("sphere", "force of contacts, for output", ("sphere_forces",)),
    "body": Named(
        "body", "course, and inertia as it is turned", (
            "body_positions", "body_turns", "body_velocities", "body_momenta", "body_starts", "body_start_turns",
            "body_masses", "body_inverse_inertias",
        ),
    ),
    BODY_PUSH: Named("body", "sums of forces and torques since it last moved", ("body_quanta", "body_turning_quanta")),
    "body_contact": Named(
        "body", "impulses between bodies, and of strings and balloons on them", (
            "body_going", "body_turning", "body_tugs", "body_twists", "body_groups", "body_gains",
            "body_touches", "body_impulses", "grips",
        ),
    ),
    "anchor": Named("string", "place of its fixed end", ("strings.anchors",)),
    "rubber": Named("triangle", "part of its tension that is left", ("membranes.wear.left",)),
    "tear": Named(
        "face", "tears, and what they leave", (
            "torn", "tear_planes", "bursts", *(f"membranes.wear.tears.{name}" for name in (
                "stresses", "face_stresses", "gone", "weakest", "ahead", "areas")),
        ),
    ),
    "force": Named("particle", "force and area vector, where they are summed", ("forces", "area_vectors")),
    "start": Named("particle", "place before the substep", ("point_starts",)),
    "look": Named("particle", "what may be near it", ("fixtures.clearances", "fixtures.nearest", "near")),
    "health": Named("world", "lowest particle or sphere that was ever where it cannot be", ("first_bad",)),
    "verdict": Named("world", "whether its frame is free", ("verdicts", "travel_limits", "any_busy")),
    "touch": Named(
        "particle", "what touches it, in sums and lists", (
            "contacts", "touched", "forces_taken", "force_quanta", "merged", "contact_impulses", "listed_contacts",
            "listed_contact_counts", "contact_shares", "contact_quanta", "contact_stops", "layer_quanta",
            "solid_shares", "solid_quanta", "ridge_budgets", "ridge_counts", "ridge_pairs", "ridge_radii", "edge_pairs",
            "list_lengths", "needs", "overflow",
        ),
    ),
}  # fmt: skip
"""State by its names, beside points, velocities and the values that phases write and items keep"""
OF_ARRAY = {array: name for name, named in NAMED.items() for array in named.arrays}


def names_of(arrays: Iterable[str]) -> frozenset[str]:
    """Return the names of arrays, those that have one."""
    return frozenset(OF_ARRAY[array] for array in arrays if array in OF_ARRAY)
