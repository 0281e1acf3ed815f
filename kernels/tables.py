"""The model as the schedules without atomics read it: what a particle needs, found from the particle.

The schedules fill these; see `balloon_warp.model.Model` for the shapes of what is named alike there.
"""

import warp as wp

from balloon_warp.kernels.springs import stretch_without_pull

SLICE = wp.constant(32)
"""particles of a slice of the spring table: the threads of a warp"""
CHUNK = wp.constant(4)
"""springs that a particle loads together"""


@wp.struct
class HingeTable:
    """The edges between two faces, and what each particle is to them; empty without torsion springs."""

    ends: wp.array[wp.vec2i]
    wing_offsets: wp.array[wp.int32]
    """where the corners of hinge n's wings begin: entries 2 n and 2 n + 1"""
    wing_particles: wp.array[wp.int32]
    rest_angles: wp.array[float]
    """[rad]"""
    particle_offsets: wp.array[wp.int32]
    """where each particle's roles begin, and after the last, where they end"""
    particle_roles: wp.array[wp.int32]
    """four times the hinge, plus the particle's role in it"""
    stiffness: wp.array2d[float]


@wp.struct
class SpringTable:
    """The springs of each particle, each spring so twice.

    In slices of 32 particles, the threads of a warp: spring `slot` of particle p stands at
    `slice_offsets[p // 32] + 32 * slot + p % 32`, so that 32 threads load 32 neighbors. A particle's slots are filled
    up to a multiple of four with springs that do nothing.
    """

    slice_offsets: wp.array[wp.int32]
    valences: wp.array[wp.int32]
    """springs of each particle"""
    ends: wp.array[wp.int32]
    """four times the particle at the other end, plus the spring's kind"""
    scales: wp.array[float]
    """a spring's constant over that of its kind; empty if all are 1"""
    rest_lengths: wp.array[float]
    """times the scale [m]"""
    stiffness: wp.array3d[float]
    viscosity: wp.array2d[float]
    yield_stretch: wp.array2d[float]
    hinges: HingeTable
    limits: wp.array[float]
    """strains at which springs are corrected"""
    yields_at_limit: bool
    """whether they do not pull there either (Tarantino)"""


@wp.struct
class CorrectionTable:
    """The springs as the position correction takes them: color by color, no two of one color at one particle."""

    color_offsets: wp.array[wp.int32]
    """where the springs of each color begin, and after the last, where they end"""
    particles: wp.array[wp.vec2i]
    rest_lengths: wp.array[float]
    """[m]"""
    limits: wp.array[float]
    """strains beyond which springs are too long, one a world or one for all"""
    sweeps: wp.int32


@wp.struct
class StringTable:
    """Strings sorted by the particle that they hold: those of p are `offsets[p]` to `offsets[p + 1]`."""

    offsets: wp.array[wp.int32]
    """empty if there are no strings"""
    particles: wp.array[wp.int32]
    """the particle that each holds, in order"""
    order: wp.array[wp.int32]
    """the string's number in the model"""
    anchors: wp.array2d[wp.vec3]
    lengths: wp.array2d[float]
    stiffness: wp.array2d[float]


@wp.struct
class BodyTable:
    """What pulls at a particle by itself."""

    balloon: wp.array[wp.int32]
    mass_share: wp.array[float]
    mass: wp.array2d[float]
    helium: wp.array2d[float]
    damping: wp.array2d[float]
    gravity: wp.array[float]
    up: wp.vec3


@wp.struct
class ObstacleTable:
    """What particles bump into."""

    sphere_mass: wp.array2d[float]
    sphere_radius: wp.array2d[float]
    sphere_penalty: wp.array2d[float]
    ground_height: wp.array[float]
    ground_friction: wp.array[float]
    ground_restitution: wp.array[float]


@wp.struct
class WaterTable:
    """A liquid below a level surface."""

    level: wp.array[float]
    density: wp.array[float]
    drag: wp.array[float]


@wp.struct
class FaceTable:
    """Faces, and the faces around each particle."""

    offsets: wp.array[wp.int32]
    particles: wp.array[wp.int32]
    balloon: wp.array[wp.int32]
    balloon_offsets: wp.array[wp.int32]
    """where each balloon's faces begin, and after the last, where they end"""
    particle_offsets: wp.array[wp.int32]
    around_particles: wp.array[wp.int32]


@wp.struct
class AirTable:
    """What fills balloons, and the air around them."""

    kind: wp.array[wp.int32]
    """of each balloon's inflation"""
    gamma: wp.array2d[float]
    molar_mass: wp.array2d[float]
    drag_coefficient: wp.array2d[float]
    pressure: wp.array[float]
    temperature: wp.array[float]
    density: wp.array[float]
    wind: wp.array[wp.vec3]
    tube_balloons: wp.array[wp.vec2i]
    tube_conductance: wp.array2d[float]
    balloon_particles: wp.array[wp.int32]
    """where each balloon's particles begin, and after the last, where they end"""


@wp.struct
class WorldState:
    """The arrays of `balloon_warp.model.State` that a schedule reads a frame from and writes it to."""

    frame: wp.array[wp.int32]
    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    inflation_aims: wp.array2d[wp.vec3]
    inflation_ramp: wp.array2d[wp.vec2]
    inflation_loads: wp.array2d[wp.vec2]
    pressures: wp.array2d[float]
    gas_amounts: wp.array2d[wp.float64]
    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_forces: wp.array2d[wp.vec3]
    first_bad: wp.array[wp.int32]


@wp.func
def row_of_world(world: wp.int32, rows: wp.int32):
    """`world % rows` for a parameter with one row, or one for each world, without a division."""
    return wp.where(rows == 1, 0, world)


@wp.func
def ground_height(obstacles: ObstacleTable, world: wp.int32):
    """[m], minus infinity where there is no ground."""
    return obstacles.ground_height[row_of_world(world, obstacles.ground_height.shape[0])]


@wp.func
def ground_friction(obstacles: ObstacleTable, world: wp.int32):
    """Coulomb's coefficient."""
    return obstacles.ground_friction[row_of_world(world, obstacles.ground_friction.shape[0])]


@wp.func
def ground_restitution(obstacles: ObstacleTable, world: wp.int32):
    """Rebound speed over impact speed of spheres."""
    return obstacles.ground_restitution[row_of_world(world, obstacles.ground_restitution.shape[0])]


@wp.func
def particle_mass(bodies: BodyTable, world: wp.int32, particle: wp.int32):
    """[kg], 0 for a fixed particle."""
    mass = bodies.mass[row_of_world(world, bodies.mass.shape[0]), bodies.balloon[particle]]
    return bodies.mass_share[particle] * mass


@wp.func
def sphere_part(bodies: BodyTable, obstacles: ObstacleTable, world: wp.int32, particle: wp.int32, sphere: wp.int32):
    """What a particle bumps into of a sphere's mass [kg], see `contact.collide`."""
    mass = obstacles.sphere_mass[row_of_world(world, obstacles.sphere_mass.shape[0]), sphere]
    return bodies.mass_share[particle] * mass / float(bodies.mass.shape[1])


@wp.func
def particle_damping(bodies: BodyTable, world: wp.int32, particle: wp.int32):
    """[N s/m]"""
    damping = bodies.damping[row_of_world(world, bodies.damping.shape[0]), bodies.balloon[particle]]
    return bodies.mass_share[particle] * damping


@wp.func
def spring_constant(springs: SpringTable, world: wp.int32, balloon: wp.int32, kind: wp.int32):
    """Of a kind of springs [N/m]."""
    return springs.stiffness[row_of_world(world, springs.stiffness.shape[0]), balloon, kind]


@wp.func
def spring_constants(springs: SpringTable, world: wp.int32, balloon: wp.int32):
    """Of each kind of springs [N/m]."""
    return wp.vec3(
        spring_constant(springs, world, balloon, 0),
        spring_constant(springs, world, balloon, 1),
        spring_constant(springs, world, balloon, 2),
    )


@wp.func
def spring_viscosity(springs: SpringTable, world: wp.int32, balloon: wp.int32):
    """Damping constant of springs over their spring constant [s]."""
    return springs.viscosity[row_of_world(world, springs.viscosity.shape[0]), balloon]


@wp.func
def spring_yield(springs: SpringTable, world: wp.int32, balloon: wp.int32):
    """Length over rest length from which on springs do not pull."""
    return stretch_without_pull(
        springs.yield_stretch[row_of_world(world, springs.yield_stretch.shape[0]), balloon],
        springs.limits[row_of_world(world, springs.limits.shape[0])],
        springs.yields_at_limit,
    )


@wp.func
def first_entry(springs: SpringTable, particle: wp.int32):
    """Where a particle's first spring stands; the next is `SLICE` further."""
    return springs.slice_offsets[particle >> 5] + (particle & 31)
