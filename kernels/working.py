"""Working memory of a substep's pieces, where each is a launch; a block has some of it, too."""

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.laws.grip import Grip


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
    """Forces on spheres since they last moved, see `fixed_point`; empty where momentum is exchanged"""
    sphere_starts: wp.array2d[wp.vec3]
    """Positions of spheres before this substep [m]; empty unless they may meet each other, or faces"""
    point_starts: wp.array2d[wp.vec3]
    """Positions of particles before this substep [m]; empty unless spheres meet faces, as is the next"""
    lumps: wp.array2d[wp.int32]
    """Particles of each world that move together with a sphere, see `contact.faces`"""
    body_starts: wp.array2d[wp.vec3]
    """Positions of free bodies before this substep [m]; empty where there are none, as are the next six"""
    body_start_turns: wp.array2d[wp.quat]
    body_masses: wp.array2d[float]  # [kg]
    body_eases: wp.array2d[wp.mat33d]
    """Inverses of the bodies' inertia tensors in the world's axes [1/(kg m^2)]"""
    body_going: wp.array2d[wp.vec3d]
    """Velocities of bodies while they push each other [m/s], or displacements out of overlaps [m]"""
    body_turning: wp.array2d[wp.vec3d]
    """Angular momenta of bodies while they push each other [kg m^2/s], or those of a rotation [kg m^2]"""
    body_pushes: wp.array2d[wp.vec3]
    """Impulse of a body on each particle [N s]"""
    grips: wp.array2d[Grip]
    """Contacts of points of bodies in this substep"""
    contact_pushes: wp.array3d[wp.vec4]
    """Impulse [N s] and contact time [s] of each thing and particle since the frame began; empty unless a scene records
    contacts, see `phases.tell`"""
    ridge_counts: wp.array2d[wp.int32]
    """Number of pairs of features of balloons and ridges that are near each other in each world: shape (world_count,
    2); the second is the number that may meet in this substep. Empty unless faces meet ridges, as are the next arrays,
    see `contact.ridges`"""
    ridge_budgets: wp.array[float]
    """Distance that anything may travel until the next search for ridges [m]"""
    ridge_pairs: wp.array2d[wp.vec3i]
    """Pairs of feature, ridge and solid that are near each other"""
    catches: wp.array2d[Catch]
    """Contacts that may happen in this substep"""
    ridge_shares: wp.array2d[wp.int32]
    """Number of contacts of each particle in a sweep"""
    ridge_body_shares: wp.array2d[wp.int32]
    """Number of contacts of each body in a sweep"""
    ridge_quanta: wp.array3d[wp.int64]
    """Impulses on each particle in a sweep, see `contact.ridge_sums`"""
    ridge_body_quanta: wp.array3d[wp.int64]
    """Impulses on bodies in a sweep, and their angular momenta"""
    near: wp.array2d[wp.int32]
    """Whether particles may touch a sphere, see `contact.spheres`; empty unless momentum is exchanged"""
    balloon_boxes: wp.array3d[wp.vec3]
    """Box around each balloon until the next search: lower and upper corner [m], and `PACE`; empty unless balloons
    touch, as are the next arrays, see `contact.boxes`"""
    sought: wp.array2d[wp.vec3]
    """Position of each particle at the last search [m]"""
    part_boxes: wp.array2d[wp.vec4]
    """Boxes around the parts of balloons' surfaces, without `PACE`: shape (world_count, 2 part_count)"""
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
    """Lengths of both lists of particles, and of that of all edges that may meet"""
    push_quanta: wp.array3d[wp.int64]
    """Contact forces on particles, and the number of contacts, in fixed point; they grow for ever, see
    `fixed_point.growth`: shape (world_count, particle_count, 4)"""
    pushes_taken: wp.array3d[wp.int64]
    """Part of `push_quanta` that particles have already received"""
    contacts: wp.array2d[float]
    """Number of contacts of each particle in the previous substep"""
    touched: wp.array2d[wp.int8]
    """Role of each particle in contacts, see `contact.forces`"""
    crowded: wp.array[wp.int32]
    """Number of candidate overflows: triangles or edges that had no place in a list"""
    edge_candidates: wp.array3d[wp.int32]
    """Edges that each edge may touch: shape (world_count, edges, most); empty unless sharp edges meet, see
    `contact.edges`, as is the next"""
    edge_counts: wp.array2d[wp.int32]
    """Number of edges that each edge may touch"""
    verdicts: wp.array[wp.int32]
    """Verdict on each world, see `contact.free_frames`; empty where no look ahead is needed, as are the next two"""
    ways: wp.array[float]
    """Distance that each particle of a world may travel in the frame [m]"""
    any_busy: wp.array[wp.int32]
    """Whether any world is not free"""
