"""Working memory of a substep's pieces, where each is a launch; a block has some of it, too.

Where a list of contacts is full it notes how long it would have to be, and the host makes it longer.
"""

import warp as wp

from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.laws.rigid import Grip

EightBoxes = wp.types.matrix(shape=(6, 8), dtype=wp.float32)
"""Lower and upper corners of eight boxes [m]"""
EightPlaces = wp.types.matrix(shape=(10, 8), dtype=wp.float32)
"""Weights, arm, squared distance and area vector of a particle beside eight triangles, see `loops.contact.Place`"""
SphereBars = wp.types.vector(length=8, dtype=wp.float32)
"""Derivatives by a sphere's center, velocity, radius and penalty"""
FixtureBars = wp.types.vector(length=7, dtype=wp.float32)
"""Derivatives by an obstacle's places as a frame begins and as it ends, and by Coulomb's coefficient on it"""


@wp.struct
class Working:
    """Arrays that a schedule keeps beside the state; those that a scene does not need are empty."""

    forces: wp.array2d[wp.vec3]
    """Force on each particle, where forces are summed or shown [N]"""
    area_vectors: wp.array2d[wp.vec3]
    """Area vector of each particle [m^2]"""
    gas_masses: wp.array2d[float]
    """Mass of the gas in each balloon [kg]"""
    sphere_quanta: wp.array3d[wp.int64]
    """Forces on spheres since they last moved, see `fixed_point`; empty where momentum is exchanged and no phase pushes
    any"""
    sphere_bars: wp.array3d[SphereBars]
    """Derivatives by each sphere that each particle has found in a substep backwards, shape (W, P, S); empty where
    nothing runs backwards, as is the next, see `adjoints.spheres`"""
    sphere_push_bars: wp.array2d[wp.vec3]
    """Derivatives by the forces on spheres since they last moved"""
    fixture_bars: wp.array3d[FixtureBars]
    """Derivatives by each obstacle that each particle has found in a frame backwards, shape (W, P, N); empty where
    nothing is derived by obstacles, see `adjoints.solids`"""
    direction_bars: wp.array2d[wp.vec3]
    """Derivatives by the direction of each particle's normal force, see `adjoints.pull`; empty where there is
    none, or nothing runs backwards"""
    sphere_starts: wp.array2d[wp.vec3]
    """Positions of spheres before this substep [m]; empty unless they may meet each other, or faces"""
    point_starts: wp.array2d[wp.vec3]
    """Positions of particles before this substep [m]; empty unless spheres meet faces, as is the next"""
    merged: wp.array2d[wp.int32]
    """Particles of each world that move together with a sphere, see `contact.spheres`"""
    body_starts: wp.array2d[wp.vec3]
    """Positions of free bodies before this substep [m]; empty where there are none, as are the next eight"""
    body_start_turns: wp.array2d[wp.quat]
    body_masses: wp.array2d[float]  # [kg]
    body_inverse_inertias: wp.array2d[wp.mat33d]
    """Inverses of the bodies' inertia tensors in the world's axes [1/(kg m^2)]"""
    body_going: wp.array2d[wp.vec3d]
    """Velocities of bodies while they push each other [m/s], or displacements out of overlaps [m]"""
    body_turning: wp.array2d[wp.vec3d]
    """Angular momenta of bodies while they push each other [kg m^2/s], or those of a rotation [kg m^2]"""
    body_tugs: wp.array2d[wp.vec3]
    """Velocities that strings give bodies in this substep [m/s]; empty where none is tied to one, as is the next"""
    body_twists: wp.array2d[wp.vec3]
    """Angular momenta that strings give them [kg m^2/s]"""
    body_quanta: wp.array3d[wp.int64]
    """Forces of phases on bodies in this substep, see `fixed_point`; empty where no phase pushes any, as is the next"""
    body_turning_quanta: wp.array3d[wp.int64]
    """Torques about their centers of mass"""
    body_groups: wp.array2d[wp.int32]
    """A body of lower number that each touches, perhaps by way of others, or itself, see `loops.holding`"""
    body_gains: wp.array2d[wp.vec4d]
    """Energy that each group of bodies would gain by contacts [J]: with all rebounds, without, and see `push_less`"""
    grips: wp.array2d[Grip]
    """Contacts of points of bodies in this substep"""
    contact_impulses: wp.array3d[wp.vec4]
    """Impulse [N s] and contact time [s] of each thing and particle since the frame began; empty unless a scene records
    contacts, see `phases.contact`"""
    listed_contacts: wp.array2d[Contact]
    """Contacts that may act in sweeps; empty unless edges, faces beside ridges or bodies meet, as are the next, see
    `contact.sweeps`"""
    listed_contact_counts: wp.array2d[wp.int32]
    """Number of these, and of those that come too near in a sweep: shape (world_count, 2)"""
    contact_shares: wp.array2d[wp.int32]
    """Number of contacts of each particle in a sweep, among which its mass is split"""
    contact_quanta: wp.array3d[wp.int64]
    """Impulses of contacts on particles in a sweep, see `contact.ends`"""
    layer_quanta: wp.array3d[wp.int64]
    """Impulses of contacts of balloons alone since the substep began; empty unless those of solids are told"""
    contact_stops: wp.array2d[wp.vec2]
    """Height by which the ground raises a particle in a sweep [m], and its upward speed [m/s]; empty forward"""
    solid_shares: wp.array2d[wp.int32]
    """Number of contacts of each free body, and then of each sphere, in a sweep; empty where they meet none"""
    solid_quanta: wp.array3d[wp.int64]
    """Impulses on these, and their angular momenta: shape (world_count, bodies and spheres, 6)"""
    ridge_counts: wp.array[wp.int32]
    """Number of pairs of features of balloons and ridges that are near each other in each world. Empty unless faces
    meet ridges, as are the next arrays, see `contact.ridges`"""
    ridge_budgets: wp.array[float]
    """Distance that anything may travel until the next search for ridges [m]"""
    ridge_pairs: wp.array2d[wp.vec3i]
    """Pairs of feature, ridge and solid that are near each other"""
    ridge_radii: wp.array2d[float]
    """Radius of each sphere at the last search for ridges [m]; empty unless faces meet spheres as ridges"""
    near: wp.array2d[wp.int32]
    """Whether particles may touch a sphere, see `contact.spheres`; empty unless momentum is exchanged"""
    balloon_boxes: wp.array3d[wp.vec3]
    """Box around each balloon until the next search: lower and upper corner [m], and `PACE`; empty unless balloons
    touch, as are the next arrays, see `contact.boxes`"""
    sought: wp.array2d[wp.vec3]
    """Position of each particle at the last search [m]"""
    clearances: wp.array2d[float]
    """Distance of each particle from triangles of its own balloon that it may touch at the last search [m], see
    `contact.triangles`; empty unless balloons touch themselves"""
    leaf_boxes: wp.array2d[wp.vec4]
    """Boxes around the leaves of balloons' surfaces, without `PACE`: shape (world_count, 2 leaf_count)"""
    row_boxes: wp.array2d[wp.vec4]
    """Boxes around as many leaves each as a warp has threads; empty on a CPU"""
    eight_boxes: wp.array2d[EightBoxes]
    """Boxes of triangles and of leaves, eight side by side, see `contact.boxes`; empty on a GPU"""
    eight_places: wp.array2d[EightPlaces]
    """Positions of the particle at hand relative to eight triangles: shape (world_count, 1); empty on a GPU"""
    near_leaves: wp.array3d[wp.int32]
    """Leaves of the same balloon near each leaf, see `contact.triangles`: shape (world_count, leaf_count, most); empty
    on a GPU, and unless balloons touch themselves, as is the next"""
    near_leaf_counts: wp.array2d[wp.int32]
    """Number of leaves near each leaf; -1 where there are more than fit"""
    neighbors: wp.array3d[wp.int32]
    """Balloons that each balloon may touch, perhaps itself: shape (world_count, balloon_count, balloon_count)"""
    neighbor_counts: wp.array2d[wp.int32]
    """Number of balloons that each balloon may touch"""
    near_balloons: wp.array2d[wp.int32]
    """Work of each balloon's particles, and last the work of the world"""
    candidate_counts: wp.array2d[wp.int32]
    """Number of triangles that each particle may touch"""
    candidates: wp.array3d[wp.int32]
    """Triangles that each particle may touch, see `contact.triangles.candidate_of`: shape (world_count, particle_count,
    most)"""
    particle_lists: wp.array3d[wp.int32]
    """Particles that search, and those that have found something, see `contact.search`"""
    list_lengths: wp.array2d[wp.int32]
    """Lengths of lists, by `LOOKING` and the others below"""
    force_quanta: wp.array3d[wp.int64]
    """Contact forces on particles, and the number of contacts, in fixed point; they grow for ever, see
    `fixed_point.growth`: shape (world_count, particle_count, 4)"""
    forces_taken: wp.array3d[wp.int64]
    """Part of `push_quanta` that particles have already received"""
    contacts: wp.array2d[float]
    """Number of contacts of each particle in the previous substep"""
    touched: wp.array2d[wp.int8]
    """Role of each particle in contacts, see `contact.response`"""
    overflow: wp.array[wp.int32]
    """Number of contacts that had no place in a list, and were ignored"""
    needs: wp.array2d[wp.int32]
    """Length that each list would have needed where it was full, or 0: (world_count, lists)"""
    edge_boxes: wp.array2d[wp.vec4]
    """Box around the sweep of each edge until the next search [m], its two corners: shape (world_count, 2 edges); empty
    unless sharp edges meet, see `contact.edges`, as are the next"""
    edge_clearances: wp.array2d[float]
    """Distance of each edge from edges of its own balloon that it may touch at the last search [m]; empty unless
    balloons touch themselves"""
    edge_pairs: wp.array2d[wp.vec3i]
    """Pairs of edges that may touch until the next search, the lower number first, or of a particle, by -1 less its
    number, and a place in its list of triangles; and in which substep after the search they may do so at the earliest.
    In any order"""
    verdicts: wp.array[wp.int32]
    """Verdict on each world, see `contact.free_frames`; empty where no look ahead is needed, as are the next two"""
    travel_limits: wp.array[float]
    """Distance that each particle of a world may travel in the frame [m]"""
    any_busy: wp.array[wp.int32]
    """Whether any world is not free"""


OF_TRIANGLES, OF_PAIRS, OF_CATCHES, OF_RIDGES = (wp.constant(which) for which in range(4))
"""Lists: triangles of a particle; pairs of edges, those that may touch in a substep, and of ridges, of a world"""
LISTS = 4
"""Number of these"""


@wp.func
def request_capacity(working: Working, world: wp.int32, which: wp.int32, needed: wp.int32, ignored: wp.int32):
    """Record the length that a list needs, and count the entries beyond its capacity."""
    wp.atomic_max(working.needs, world, which, needed)
    wp.atomic_add(working.overflow, world, ignored)


LOOKING, TOUCHING = wp.constant(0), wp.constant(1)
"""Particles that search, and those that have found triangles"""
PAIRS = wp.constant(2)
"""Pairs of edges, and of particles and triangles, that may touch until the next search"""
SUBSTEPS = wp.constant(3)
"""Substeps in which edges have met since the search"""
LENGTHS = 4
"""Number of these"""
