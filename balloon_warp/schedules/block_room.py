"""Capacity of a thread block for particles: in shared memory, and in threads."""

from balloon_warp.model import Model

MOST_THREADS = 1024
"""Largest number of threads of a block"""
BYTES_PER_PARTICLE = 24
"""Bytes of a particle: two buffers of points"""
RESERVED_BYTES = 2048
"""Shared memory for spheres and the sums of areas and swellings of a balloon or two [bytes]"""
CPU_TILE_BYTES = 1 << 18
"""Shared memory of the CPU, which emulates a GPU here: a block of one thread, a tile of a GPU's size [bytes]"""
CAPACITY_STEP = 512
"""Granularity of the streaming kernel's capacity, so that few are compiled"""


def thread_a_particle(model: Model) -> bool:
    """Return whether a block has a thread for each particle of a world."""
    return model.particle_count <= MOST_THREADS


def fits_in_block(model: Model) -> bool:
    """Return whether a world's points, in two buffers, fit in the shared memory of a block."""
    return model.particle_count <= most_particles(model)


def most_particles(model: Model, bytes_per_particle: int = BYTES_PER_PARTICLE) -> int:
    """Return the largest number of particles whose points fit in shared memory, at a number of bytes each."""
    if model.device.is_cpu:
        return CPU_TILE_BYTES // bytes_per_particle
    # bytes for each further balloon or sphere, of the most warps; in water, of what floats, too
    sums = 1 << 11 if model.scene.water else 1 << 10
    presses = 1 << 13 if model.scene.contact == "impulse" else 0
    reserved = RESERVED_BYTES + presses + sums * (model.balloon_count + model.sphere_count)
    capacity = (model.device.max_shared_memory_per_block - reserved) // bytes_per_particle
    return capacity // CAPACITY_STEP * CAPACITY_STEP
