"""Storage of a membrane face's forces on its corners, until the threads of the particles read them."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.memory import in_tile, put_vector, vector_at

VECTOR_BYTES = 12
"""Bytes of a point"""
PLACE_BYTES = 8
"""Bytes of an entry of two words; those of four words take twice as many"""


class MembraneFacePlaces(NamedTuple):
    """Functions that go by a place: `step` times a corner times the number of faces plus the face."""

    step: int
    put: Any
    """(pulls, area_vectors, place, pull, area_vector)"""
    get: Any
    """(pulls, area_vectors, place) to the pull [N] and the area vector [m^2]"""
    point_at: Any
    """(points, corner) to the point of a face's corner [m], as the corners stand in the table"""
    velocity_at: Any
    """(velocities, corner) to its velocity [m/s], which is in memory"""


class MembraneFaceLayout(NamedTuple):
    """Hold how a block goes through the faces of membranes."""

    slots: int
    """Largest number of faces at a particle"""
    triangles: int
    """Largest number of triangles at a face"""
    mixed: bool
    """Whether some faces have fewer triangles"""
    areas: bool
    """Whether area vectors are stored, too: the membrane's faces are then all faces"""
    quads: int = 0
    """Number of quads that each thread keeps in registers; 0 where all are read in every substep"""
    tile: int = 0
    """Number of entries in shared memory; 0 where forces are stored in global memory"""
    capacity: int = 0
    """Number of points in a tile"""
    room: int = 0
    """Number of faces that threads have room for, where they keep them"""


def membrane_face_places(membrane_face: MembraneFaceLayout) -> MembraneFacePlaces:
    """Return the storage of a layout with faces of membranes."""
    return (
        in_tiles(membrane_face.tile, membrane_face.capacity, membrane_face.areas) if membrane_face.tile else in_arrays()
    )


def put_words(count: int) -> str:
    """Return code that writes an entry of 2 or 4 words: on a GPU in one instruction, unlike Warp's own."""
    words = ", ".join(f"v[{n}]" for n in range(count))
    entry = entry_of(count)
    return gpu_or_cpu(f"*(float{count}*){entry} = make_float{count}({words});", f"*(wp::vec{count}*){entry} = v;")


def get_words(count: int) -> str:
    """Return code that reads an entry of 2 or 4 words."""
    words = ", ".join(f"v.{axis}" for axis in "xyzw"[:count])
    entry = entry_of(count)
    read = f"const float{count} v = *(const float{count}*){entry}; return wp::vec{count}({words});"
    return gpu_or_cpu(read, f"return *(const wp::vec{count}*){entry};")


def entry_of(count: int) -> str:
    """Return the address of an entry of a number of words in a tile, from a place in units of two words."""
    return f"((char*)tile.data.ptr + {count // 2}u * (unsigned int)place)"


def gpu_or_cpu(gpu: str, cpu: str) -> str:
    """Return code for a GPU and for a CPU."""
    return f"\n#if defined(__CUDA_ARCH__)\n    {gpu}\n#else\n    {cpu}\n#endif\n"


@cache
def in_tiles(places: int, capacity: int, areas: bool) -> MembraneFacePlaces:
    """Return storage in shared memory, in entries of four and of two words, each read by one instruction.

    The first has the force and the first component of the area vector, the second the other two.

    Args:
        places: Number of entries.
        capacity: Number of points that a tile holds.
        areas: Whether area vectors are stored, too.
    """
    Points = wp.tile(dtype=wp.vec3, shape=(capacity,), storage="shared")  # noqa: N806 - types
    Fours = wp.tile(dtype=wp.vec4, shape=(places,), storage="shared")  # noqa: N806
    Twos = wp.tile(dtype=wp.vec2, shape=(places if areas else 1,), storage="shared")  # noqa: N806

    @wp.func_native(put_words(4))
    def put_four(tile: Fours, place: wp.int32, v: wp.vec4): ...

    @wp.func_native(put_words(2))
    def put_two(tile: Twos, place: wp.int32, v: wp.vec2): ...

    @wp.func_native(get_words(4))
    def four_at(tile: Fours, place: wp.int32) -> wp.vec4: ...

    @wp.func_native(get_words(2))
    def two_at(tile: Twos, place: wp.int32) -> wp.vec2: ...

    @wp.func_native("return *(const wp::vec3*)((const char*)tile.data.ptr + (unsigned int)byte);")
    def point_at(tile: Points, byte: wp.int32) -> wp.vec3:
        """Return a point of a tile, from the offset of its first byte."""
        ...

    @wp.func_native("return *(const wp::vec3*)((const char*)velocities.data + (unsigned int)byte);")
    def velocity_at(velocities: wp.array[wp.vec3], byte: wp.int32) -> wp.vec3:
        """Return a velocity of an array, whose offset is that of its particle's point in the tile."""
        ...

    @wp.func
    def put(pulls: Any, area_vectors: Any, place: wp.int32, pull: wp.vec3, area_vector: wp.vec3):
        put_four(pulls, place, wp.vec4(pull[0], pull[1], pull[2], area_vector[0]))
        if wp.static(areas):
            put_two(area_vectors, place, wp.vec2(area_vector[1], area_vector[2]))

    @wp.func
    def get(pulls: Any, area_vectors: Any, place: wp.int32):
        four = four_at(pulls, place)
        two = wp.vec2()
        if wp.static(areas):
            two = two_at(area_vectors, place)
        return wp.vec3(four[0], four[1], four[2]), wp.vec3(four[3], two[0], two[1])

    return MembraneFacePlaces(PLACE_BYTES, put, get, point_at, velocity_at)


@cache
def in_arrays() -> MembraneFacePlaces:
    """Return storage in global memory, for forces alone."""

    @wp.func
    def put(pulls: Any, area_vectors: Any, place: wp.int32, pull: wp.vec3, area_vector: wp.vec3):
        put_vector(pulls, place, pull)

    @wp.func
    def get(pulls: Any, area_vectors: Any, place: wp.int32):
        return vector_at(pulls, place), wp.vec3()

    return MembraneFacePlaces(1, put, get, in_tile, vector_at)
