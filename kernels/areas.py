"""The areas of balloons, summed in a fixed order, so that they come out the same to the last bit every time."""

import warp as wp


@wp.kernel(enable_backward=False)
def sum_face_areas(
    # model
    balloon_face_offsets: wp.array[wp.int32],
    # state in
    face_area_vectors: wp.array2d[wp.vec3],
    # state out
    balloon_areas: wp.array2d[float],
):
    """A block a (world, balloon): the area of the balloon, summed in the same order every time."""
    world, balloon, lane = wp.tid()
    part = float(0.0)
    for face in range(balloon_face_offsets[balloon] + lane, balloon_face_offsets[balloon + 1], wp.block_dim()):
        part += wp.length(face_area_vectors[world, face])
    wp.tile_store(balloon_areas[world], wp.tile_sum(wp.tile(part)), offset=balloon)
