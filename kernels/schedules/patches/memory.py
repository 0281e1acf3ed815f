"""How worlds are cut into patches, and what these show each other."""

import warp as wp


@wp.struct
class PatchTable:
    """The patches of a world, each of one balloon. In a patch's tables and tiles a particle of its own stands at the
    place of its thread, and one of its rim behind all threads. There are no more of a rim than threads."""

    numbers: wp.array2d[wp.int32]
    """the particle of each thread, and their count where there is none, shape (patches, threads)"""
    rims: wp.array2d[wp.int32]
    """the particle of the rim that each thread reads, -1 where there is none, shape (patches, threads)"""
    in_rims: wp.array[wp.int32]
    """1 for a particle that is in the rim of another patch"""
    origins: wp.array[wp.int32]
    """place of the particle that a balloon's volume is measured from"""
    balloons: wp.array[wp.int32]
    """of each patch"""
    firsts: wp.array[wp.int32]
    """patches of each balloon begin there, and after the last, end"""
    face_offsets: wp.array[wp.int32]
    """faces of each patch begin there, and after the last, end, where normals are fresh: each is of the patch that
    its first corner is in"""


@wp.struct
class PatchMemory:
    """What patches keep in global memory; arrays that a scene does not need are empty. Even and odd substeps have
    entries of their own: who tells something has heard what others told in the substep before."""

    points: wp.array[wp.vec4]
    """of particles in rims, of the worlds at work"""
    sums: wp.array[wp.vec4]
    """of the part of a balloon in each patch, in two entries: how it would swell, or its area"""


@wp.struct
class PatchSeat:
    """Where a thread sits, and whom it listens to."""

    slot: wp.int32  # of the world, among those at work
    slots: wp.int32  # how many there are
    patches: wp.int32  # of a world
    patch: wp.int32
    thread: wp.int32
    rim: wp.int32  # the particle that it reads, or -1
    told: bool  # its own particle is read by others
    begin: wp.int32  # first patch of the balloon
    count: wp.int32  # patches of the balloon


@wp.func
def take_patch(patches: PatchTable, count: wp.int32, slot: wp.int32, patch: wp.int32, thread: wp.int32):
    """As a frame begins.

    Args:
        count: of worlds at work.
        slot: of the world, among these.
    """
    seat = PatchSeat()
    seat.slot = slot
    seat.slots = count
    seat.patches = patches.balloons.shape[0]
    seat.patch = patch
    seat.thread = thread
    seat.rim = patches.rims[patch, thread]
    number = patches.numbers[patch, thread]
    if number < patches.in_rims.shape[0]:
        seat.told = patches.in_rims[number] != 0
    seat.begin = patches.firsts[patches.balloons[patch]]
    seat.count = patches.firsts[patches.balloons[patch] + 1] - seat.begin
    return seat
