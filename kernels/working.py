"""What the pieces of a substep tell each other, where each is a launch; a block has some of it, too."""

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.laws.grip import Grip


@wp.struct
class Working:
    """What a schedule keeps beside the state; arrays that a scene does not need are empty."""

    forces: wp.array2d[wp.vec3]
    """on each particle, where they are added up or shown [N]"""
    area_vectors: wp.array2d[wp.vec3]
    """of each particle [m^2]"""
    gas_masses: wp.array2d[float]
    """in each balloon [kg]"""
    sphere_quanta: wp.array3d[wp.int64]
    """forces on spheres since they last moved, see `fixed_point`; empty where momentum is exchanged"""
    sphere_starts: wp.array2d[wp.vec3]
    """where spheres were before this substep [m]; empty unless they may meet each other, or faces"""
    point_starts: wp.array2d[wp.vec3]
    """where particles were; empty unless spheres meet faces, as is the next"""
    lumps: wp.array2d[wp.int32]
    """particles of each world that go on together with a sphere, see `contact.faces`"""
    body_starts: wp.array2d[wp.vec3]
    """where free bodies were before this substep [m]; empty where there are none, as are the next six"""
    body_start_turns: wp.array2d[wp.quat]
    body_masses: wp.array2d[float]  # [kg]
    body_eases: wp.array2d[wp.mat33d]
    """inverses of their inertia tensors in the world's axes [1/(kg m^2)]"""
    body_going: wp.array2d[wp.vec3d]
    """how fast they are while they push each other [m/s], or how far they are to be moved out of overlaps [m]"""
    body_turning: wp.array2d[wp.vec3d]
    """their angular momenta then [kg m^2/s], or the same of a turn [kg m^2]"""
    body_pushes: wp.array2d[wp.vec3]
    """what a body has pressed each particle with [N s]"""
    grips: wp.array2d[Grip]
    """what points of bodies meet in this substep"""
    contact_pushes: wp.array3d[wp.vec4]
    """of each thing and particle since the frame began: the impulse [N s], and for how long they have touched [s];
    empty unless a scene asks for contacts, see `phases.tell`"""
    ridge_counts: wp.array2d[wp.int32]
    """pairs of features of balloons and ridges that are near each other in each world: shape (world_count, 2), of
    which the second is how many may meet in this substep; empty unless faces meet ridges, as is what follows, see
    `contact.ridges`"""
    ridge_budgets: wp.array[float]
    """how far anything may go until it is looked again [m]"""
    ridge_pairs: wp.array2d[wp.vec3i]
    """those pairs: feature, ridge and solid"""
    catches: wp.array2d[Catch]
    """those that may meet in this substep"""
    ridge_shares: wp.array2d[wp.int32]
    """contacts of each particle in a sweep"""
    ridge_body_shares: wp.array2d[wp.int32]
    """the same of bodies"""
    ridge_quanta: wp.array3d[wp.int64]
    """impulses on each particle in a sweep, see `contact.ridge_sums`"""
    ridge_body_quanta: wp.array3d[wp.int64]
    """the same on bodies, and their angular momenta"""
    near: wp.array2d[wp.int32]
    """whether particles may touch a sphere, see `contact.spheres`; empty unless momentum is exchanged"""
    balloon_boxes: wp.array3d[wp.vec3]
    """around each balloon until the next search: lower and upper corner [m], and `PACE`; this and what follows is empty
    unless balloons touch, see `contact.boxes`"""
    sought: wp.array2d[wp.vec3]
    """where each particle was at the last search [m]"""
    part_boxes: wp.array2d[wp.vec4]
    """the same around each part of their surfaces, without `PACE`: shape (world_count, 2 part_count)"""
    neighbors: wp.array3d[wp.int32]
    """which each balloon may meet, perhaps itself: shape (world_count, balloon_count, balloon_count)"""
    neighbor_counts: wp.array2d[wp.int32]
    """how many they are"""
    near_balloons: wp.array2d[wp.int32]
    """what each balloon's particles do, and last what there is to do in the world"""
    candidate_counts: wp.array2d[wp.int32]
    """triangles that each particle may touch"""
    candidates: wp.array3d[wp.int32]
    """those triangles, see `contact.triangles.candidate_of`: shape (world_count, particle_count, most)"""
    particle_lists: wp.array3d[wp.int32]
    """those that look around, and those that have found something, see `contact.search`"""
    list_lengths: wp.array2d[wp.int32]
    """of both, and of all edges that may meet"""
    push_quanta: wp.array3d[wp.int64]
    """forces of contacts on particles, and how many they are, in parts; they add up for ever, see `fixed_point.growth`:
    shape (world_count, particle_count, 4)"""
    pushes_taken: wp.array3d[wp.int64]
    """how much of that particles have had"""
    contacts: wp.array2d[float]
    """how many they had in the substep before"""
    touched: wp.array2d[wp.int8]
    """what contacts have to do with each particle, see `contact.forces`"""
    crowded: wp.array[wp.int32]
    """how often a triangle, or an edge, had no place in a list"""
    edge_candidates: wp.array3d[wp.int32]
    """edges that each may meet: shape (world_count, edges, most); empty unless sharp edges meet, see `contact.edges`,
    as is the next"""
    edge_counts: wp.array2d[wp.int32]
    """how many they are"""
    verdicts: wp.array[wp.int32]
    """of each world, see `contact.free_frames`; empty where worlds need no look ahead, as are the next two"""
    ways: wp.array[float]
    """how far each of its particles may go in the frame [m]"""
    any_busy: wp.array[wp.int32]
    """whether any world is not free"""
