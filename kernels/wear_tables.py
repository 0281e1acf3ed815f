"""Tables of wear for kernels: softening and tearing of membranes."""

import warp as wp


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
    """Strength of balloons, see `laws.tearing`, shape (W, balloon_count), as are the next four"""
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
    """Face and stress where each balloon is to burst, see `schedules.launched_tears`"""


@wp.struct
class WearTable:
    """Wear of membranes that soften or may tear; empty where none does."""

    left: wp.array2d[float]
    """Factor on the tension of each triangle in this substep, shape (world_count, triangle_count)"""
    numbers: wp.array[wp.int32]
    """Triangle of each entry of `MembraneTable.others`"""
    softening: wp.array2d[float]
    """Softening of balloons, see `laws.softening`, shape (W, balloon_count), as are the next two"""
    softening_energy: wp.array2d[float]
    softening_share: wp.array2d[float]
    tears: TearTable
