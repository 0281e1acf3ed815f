"""Whether the particles of a world live in the registers of a thread block, and how many to a thread."""

from dataclasses import dataclass

from balloon_warp.kernels.inflation import NORMAL_FORCE
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.schedules.rings import Ring, quad_rings
from balloon_warp.schedules.slots import kind_slots
from balloon_warp.schedules.tables import SpringEnds
from balloon_warp.schedules.traits import beyond_basics, model_traits

WARP_THREADS = 32
MOST_THREADS = 1024
"""of a block"""
MOST_THREADS_OF_MULTIPROCESSOR = 2048
REGISTERS = 65536
"""of a multiprocessor"""
QUARTERS = 4
"""of a multiprocessor, among which its warps and registers are shared out"""
MOST_REGISTERS = 248
"""of a thread"""
AIR_REGISTERS = 40
"""of a thread beside its springs, with pressure or gas"""


@dataclass(frozen=True)
class Residence:
    """How the particles of a world live in the registers of a block."""

    particles_a_thread: int
    threads: int
    registers: int
    """of a thread"""
    blocks: int
    """that a multiprocessor runs at once"""


def residence(model: Model, ends: SpringEnds) -> Residence | None:
    """The layout that lets most worlds run at once on a multiprocessor; None if the springs do not fit in registers.

    Two particles a thread share what a thread does for itself (spheres, barriers), and their loads overlap; where a
    multiprocessor has no second block to turn to while it waits, more threads with one particle each are faster.
    """
    if not thread_a_particle(model) or model.device.is_cpu or beyond_basics(model) or model_traits(model).impulses:
        return None
    single, double = _layout(model, ends, 1), _layout(model, ends, 2)
    if single and double:
        return double if double.blocks >= max(single.blocks, 2) else single
    return single or double


def residence_in_air(model: Model, ends: SpringEnds) -> tuple[Residence, Ring] | None:
    """The layout and the rings of quads for balloons with pressure or gas; None where a balloon has neither, is not of
    quads all around, shares its gas through a tube, or where there is more than air."""
    fits = thread_a_particle(model) and model.device.is_cuda
    if not fits or model_traits(model) != Traits(springs_vary=ends.vary, in_air=True):
        return None
    if NORMAL_FORCE in model.inflation_kind.numpy() or model.tube_balloons.shape[0]:
        return None
    rings = quad_rings(model, ends)
    home = _layout(model, ends, 1, AIR_REGISTERS) if rings else None
    return (home, rings) if home and rings else None


def _layout(model: Model, ends: SpringEnds, particles_a_thread: int, others: int = 12) -> Residence | None:
    """With as many blocks as leave registers for the springs, and for so many others of a thread."""
    threads = -(-model.particle_count // (WARP_THREADS * particles_a_thread)) * WARP_THREADS
    needed = others + particles_a_thread * (24 + (3 if ends.vary else 2) * sum(kind_slots(ends)))
    for blocks in range(_useful_blocks(model, threads), 0, -1):
        warps_of_quarter = -(-blocks * threads // WARP_THREADS // QUARTERS)
        registers = min(REGISTERS // QUARTERS // WARP_THREADS // warps_of_quarter // 8 * 8, MOST_REGISTERS)
        if registers >= needed:
            return Residence(particles_a_thread, threads, registers, blocks)
    return None


def _useful_blocks(model: Model, threads: int) -> int:
    """Blocks of a multiprocessor that there are worlds for, and that its threads allow."""
    return min(-(-model.world_count // model.device.sm_count), MOST_THREADS_OF_MULTIPROCESSOR // threads)


def thread_a_particle(model: Model) -> bool:
    """Whether a block has a thread for each particle of a world."""
    return model.particle_count <= MOST_THREADS
