"""Patches of worlds, and the memory that they share."""

import warp as wp


@wp.struct
class PatchTable:
    """Patches of a world, each of one balloon.

    In a patch's tables and tiles an own particle has the index of its thread, and a halo particle comes after all
    threads. There are at most as many halo particles as threads.
    """

    numbers: wp.array2d[wp.int32]
    """Particle of each thread; the particle count where there is none, shape (patches, threads)"""
    halos: wp.array2d[wp.int32]
    """Halo particle that each thread reads, -1 where there is none, shape (patches, threads)"""
    in_halos: wp.array[wp.int32]
    """1 for a particle that is in the rim of another patch"""
    origins: wp.array[wp.int32]
    """Index of the particle about which a balloon's volume is summed"""
    balloons: wp.array[wp.int32]
    """Balloon of each patch"""
    firsts: wp.array[wp.int32]
    """Begin of each balloon's patches, and the end of the last"""
    face_offsets: wp.array[wp.int32]
    """Begin of each patch's faces, and the end of the last, where normals are fresh: a face belongs to the patch of its
    first corner"""


@wp.struct
class PatchMemory:
    """Global memory of patches; arrays that a scene does not need are empty.

    Even and odd substeps have separate entries: a block that publishes has received the entries of others of the
    substep before.
    """

    points: wp.array[wp.vec4]
    """Positions of halo particles of the worlds at work"""
    sums: wp.array[wp.vec4]
    """Sums over the part of a balloon in each patch, in two entries: its swelling, or its area"""


@wp.struct
class PatchSeat:
    """Patch of a thread, and the blocks that it listens to."""

    slot: wp.int32  # of the world, among those at work
    slots: wp.int32  # how many there are
    patches: wp.int32  # of a world
    patch: wp.int32
    thread: wp.int32
    halo: wp.int32  # the particle that it reads, or -1
    is_published: bool  # its own particle is read by others
    begin: wp.int32  # first patch of the balloon
    count: wp.int32  # patches of the balloon


@wp.func
def take_patch(patches: PatchTable, count: wp.int32, slot: wp.int32, patch: wp.int32, thread: wp.int32):
    """Take a patch as a frame begins.

    Args:
        count: Number of worlds at work.
        slot: Index of the world among these.
    """
    seat = PatchSeat()
    seat.slot = slot
    seat.slots = count
    seat.patches = patches.balloons.shape[0]
    seat.patch = patch
    seat.thread = thread
    seat.halo = patches.halos[patch, thread]
    number = patches.numbers[patch, thread]
    if number < patches.in_halos.shape[0]:
        seat.is_published = patches.in_halos[number] != 0
    seat.begin = patches.firsts[patches.balloons[patch]]
    seat.count = patches.firsts[patches.balloons[patch] + 1] - seat.begin
    return seat
