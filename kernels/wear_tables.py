"""What becomes of membranes as they are stretched, as kernels read it."""

import warp as wp


@wp.struct
class TearTable:
    """Of membranes that may tear; empty where none may. What is found in a substep is of each world."""

    triangle_offsets: wp.array[wp.int32]
    """where each face's triangles begin in `triangles`, and after the last, where they end"""
    triangles: wp.array[wp.int32]
    neighbor_offsets: wp.array[wp.int32]
    """where the faces begin that share an edge with each"""
    neighbors: wp.array[wp.int32]
    edges: wp.array[wp.vec2i]
    """which edge that is, by its particles"""
    rests: wp.array[wp.vec3]
    """particles on the unstretched skin [m]"""
    centers: wp.array[wp.vec3]
    """of faces there [m]"""
    normals: wp.array[wp.vec3]
    """and unit normals"""
    ways: wp.array[float]
    """of balloons: how far from where it began a tear branches, and again [m]"""
    branchings: wp.array[wp.int32]
    """how often it may; where it begins is the first time"""
    film_strength: wp.array2d[float]
    """of balloons, see `laws.tearing`, shape (W, balloon_count), as are the next four"""
    tear_strength: wp.array2d[float]
    branching_stress: wp.array2d[float]
    tear_speed: wp.array2d[float]
    needle_time: wp.array2d[float]
    stresses: wp.array2d[float]
    """the larger true stress of each triangle [Pa]"""
    gone: wp.array2d[wp.int8]
    """1 of each face that is torn"""
    face_stresses: wp.array2d[float]
    """the mean of its triangles' [Pa]"""
    ahead: wp.array2d[float]
    """of faces that tear in this substep: how far the tear has run beyond each [m], negative of others"""
    areas: wp.array3d[wp.int64]
    """of balloons that burst, of torn faces and of the others, in square micrometers, which add up alike in any
    order"""
    weakest: wp.array2d[wp.int64]
    """of each balloon that is to burst, the face where, and its stress, see `schedules.launched_tears`"""


@wp.struct
class WearTable:
    """Of membranes that soften or may tear; empty where none does."""

    left: wp.array2d[float]
    """what is left of the tension of each triangle in this substep, shape (world_count, triangle_count)"""
    numbers: wp.array[wp.int32]
    """the triangle of each entry of `MembraneTable.others`"""
    softening: wp.array2d[float]
    """of balloons, see `laws.softening`, shape (W, balloon_count), as are the next two"""
    softening_energy: wp.array2d[float]
    softening_share: wp.array2d[float]
    tears: TearTable
