"""Tables of contact for kernels: spheres, obstacles, bodies and touching balloons."""

import warp as wp

from balloon_warp.kernels.laws.ridges import Ridge


@wp.struct
class SphereTable:
    """Spheres with which particles collide."""

    numbers: wp.array3d[float]
    """Parameters of spheres, shape (W, sphere_count, width), see `laws.columns`"""
    small: wp.array[wp.int32]
    """Whether each sphere is so small that it also touches faces; empty where none is"""
    triangles: wp.array[wp.vec3i]
    """Particles of each triangle that small spheres may touch; empty where no sphere is small"""


@wp.struct
class Solid:
    """A shape as a signed distance, see `laws.fixture`."""

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
    looks: wp.array2d[wp.vec4]
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
    eases: wp.array[wp.mat33]
    """Inverses of the inertia tensors of 1 kg [1/m^2]"""
    samples: wp.array[wp.vec4]
    """Centers of balls inside bodies that are held out of other solids [m], and their radii [m]"""
    sample_ends: wp.array[wp.vec4i]
    """Begin of each body's samples, and the ends of those that count on the ground, at bodies, and at obstacles"""


@wp.struct
class TouchTable:
    """Surfaces as triangles, in a tree of parts, for balloons that touch; empty where none do.

    A balloon's parts stand in the order in which one comes to them who looks into each: a part, and then those in it.
    """

    triangles: wp.array[wp.vec3i]
    """Particles of each triangle, counter-clockwise from outside"""
    parts: wp.array[wp.vec4i]
    """Bounding volume tree, by part: the next part outside this one's subtree; begin and end of its triangles; its
    balloon. A part's children are the next part, and the one after that"""
    parts_by_level: wp.array[wp.int32]
    """Leaves first, then the other parts after their children"""
    levels: wp.array[wp.int32]
    """Begin of each level of parts whose boxes can be built in parallel, and the end of the last"""
    particles: wp.array[wp.int32]
    """Particles of the leaves, each once in a leaf"""
    part_particles: wp.array[wp.vec2i]
    """Begin and end of each leaf's particles; empty for other parts"""
    balloon_parts: wp.array[wp.int32]
    """Begin of each balloon's parts, and the end of the last"""
    rest_boxes: wp.array2d[wp.vec3]
    """Boxes of parts at the start: lower and upper corner [m]; empty unless balloons touch themselves"""
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
    homes: wp.array[wp.int32]
    """Leaf of a triangle of each particle; empty unless balloons touch themselves"""
    edges: wp.array[wp.vec2i]
    """Particles of the edges that touch others, leaf by leaf; empty where none do"""
    edge_homes: wp.array[wp.int32]
    """Leaf of each edge"""
    part_edges: wp.array[wp.vec2i]
    """Begin and end of each leaf's edges; empty for other parts"""


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
