"""What particles touch, as kernels read it: spheres, obstacles, and each other."""

import warp as wp

from balloon_warp.kernels.laws.ridges import Ridge


@wp.struct
class SphereTable:
    """What particles bump into."""

    mass: wp.array2d[float]
    radius: wp.array2d[float]
    penalty: wp.array2d[float]
    restitution: wp.array2d[float]
    """of spheres that meet spheres"""
    small: wp.array[wp.int32]
    """whether each is so small beside faces that it meets these, too; empty where none is"""
    triangles: wp.array[wp.vec3i]
    """the particles of each triangle that they meet; empty where none is small"""


@wp.struct
class Solid:
    """A shape as a signed distance, see `laws.fixture`."""

    kind: wp.int32
    size: wp.vec3
    """half the edges of a box; radius and half the length of a capsule [m]"""
    mesh: wp.uint64
    closed: wp.int32
    thickness: float
    """how far from the surface particles are held [m]"""
    reach: float
    """of the farthest point from the origin [m]"""
    blur: float
    """of a mesh, over its mean edge: by how much more two of its places are away from a point, if float32 tells"""


@wp.struct
class FixtureTable:
    """Obstacles that go where they are told."""

    solids: wp.array[Solid]
    motion: wp.array2d[wp.transform]
    """shift from its position, and how it is turned, at the start of each frame until it rests, shape (frames, N)"""
    positions: wp.array2d[wp.vec3]
    restitutions: wp.array2d[float]
    """of spheres"""
    samples: wp.array[wp.vec4]
    """centers of balls in them that free bodies are held out of [m], and their radii [m]; empty where there are none"""
    sample_ends: wp.array[wp.vec2i]
    """where each obstacle's begin and end"""
    fastest: float
    """how fast a point of any of them may move [m/s]"""
    looks: wp.array2d[wp.vec4]
    """working memory, of each world and particle: where it was when it last looked at them, and up to which distance
    there was nothing, plus how far `fastest` goes until then [m]; 0 at the start of a frame"""
    nearest: wp.array2d[wp.vec2]
    """the same of all but the nearest, and its number; empty for a single obstacle"""


@wp.struct
class BodyTable:
    """Free rigid bodies about their centers of mass, see `loops.bodies`; empty where there are none."""

    solids: wp.array[Solid]
    mass: wp.array2d[float]
    restitution: wp.array2d[float]
    inertias: wp.array[wp.mat33]
    """of 1 kg, about the center of mass [m^2]"""
    eases: wp.array[wp.mat33]
    """their inverses [1/m^2]"""
    samples: wp.array[wp.vec4]
    """centers of balls in them that are held out of what is in the way [m], and their radii [m]"""
    sample_ends: wp.array[wp.vec4i]
    """where each body's samples begin, and where those end that count on the ground, at bodies, and at obstacles"""


@wp.struct
class TouchTable:
    """Surfaces as triangles, in a tree of parts, for balloons that touch; empty where none do.

    A balloon's parts stand in the order in which one comes to them who looks into each: a part, and then those in it.
    """

    triangles: wp.array[wp.vec3i]
    """the particles of each, counter-clockwise from outside"""
    parts: wp.array[wp.vec4i]
    """after each part, the next that is not in it: the very next, where it has none in it; where its triangles begin
    and end; its balloon. Others in it are two: the next, and the one after that"""
    parts_by_level: wp.array[wp.int32]
    """first those that have no others in them; the others after those that are in them"""
    levels: wp.array[wp.int32]
    """where in that order the parts begin whose boxes can be made at once, and after the last, where they end"""
    particles: wp.array[wp.int32]
    """of the parts that have no others in them, each once in a part"""
    part_particles: wp.array[wp.vec2i]
    """where each part's particles begin and end; nowhere, where it has others in it"""
    balloon_parts: wp.array[wp.int32]
    """where each balloon's parts begin, and after the last, where they end"""
    rest_boxes: wp.array2d[wp.vec3]
    """around parts at the start: lower and upper corner [m]; empty unless balloons touch themselves"""
    closed: wp.array[wp.int32]
    """of each balloon, whether it has an inside, out of which others are pushed"""
    thickness: wp.array[float]
    """of each balloon's skin, where the scene does not say it [m]"""
    slack: wp.array[float]
    """of each balloon, what its particles may gain on each other by accelerating, until they are looked for again
    [m]"""
    depth: wp.array[float]
    """of each balloon, down to which what is inside is pushed out the nearest way [m]"""
    crowd: wp.array[float]
    """of each balloon, contacts on a particle that the step allows for"""
    stiffness: wp.array2d[float]
    """of each balloon's contacts, where the scene does not say it [N/m]"""
    rest_points: wp.array[wp.vec3]
    """of particles, at the start [m]; empty unless balloons touch themselves"""
    apart: wp.array[float]
    """of each balloon, how far a particle must have been from a triangle of it at the start to touch it [m]"""
    seconds: float
    """between two searches"""
    edges: wp.array[wp.vec2i]
    """the particles of those edges that meet others, balloon by balloon; empty where none do"""
    balloon_edges: wp.array[wp.int32]
    """where each balloon's edges begin, and after the last, where they end"""


@wp.struct
class RidgeTable:
    """Ridges of all solids: first obstacles, then free bodies; empty where faces do not meet them."""

    ridges: wp.array[Ridge]
    ends: wp.array[wp.vec2i]
    """where each solid's begin and end"""
    trees: wp.array[wp.uint64]
    """of boxes around the ridges of each solid; 0 for one without any"""
    features: wp.array[wp.vec4i]
    """triangles and edges of balloons: their particles, -1 in place of an edge's third, and their balloon"""
    kept: float
    """distance that faces keep from ridges [m]"""
    margin: float
    """how much further off ridges are noted [m]"""
