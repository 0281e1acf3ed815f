"""Whether the particles of a world live in the registers of a thread block, and how many to a thread."""

from dataclasses import dataclass

from balloon_warp.kernels.schedules.block.memory import FilmLayout
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.schedules.block_room import MOST_THREADS, thread_a_particle
from balloon_warp.schedules.films import film_entries
from balloon_warp.schedules.rings import Ring, quad_rings
from balloon_warp.schedules.slots import kind_slots
from balloon_warp.schedules.spring_ends import SpringEnds

WARP_THREADS = 32
MOST_THREADS_OF_MULTIPROCESSOR = 2048
REGISTERS = 65536
"""of a multiprocessor"""
QUARTERS = 4
"""of a multiprocessor, among which its warps and registers are shared out"""
MOST_REGISTERS = 248
"""of a thread"""
OWN_REGISTERS, GAS_REGISTERS = 12, 28
"""of a thread beside its particles, without and with gas"""
FILM_REGISTERS = 4
"""more, to measure a face of a membrane that is read anew. With 80 registers and three blocks a few wait in local
memory: 3 to 5 % faster than two blocks of 96 or 128, and 23 % than one particle in 64."""
QUAD_REGISTERS = 20
"""for each quad of a membrane that a thread holds, which is 22 % faster with two blocks of 128"""
MOST_QUADS = 2
"""that it does"""
SUM_BYTES = 2048
"""of shared memory of a block, beside tiles"""
CONTACT_REGISTERS = 28
"""more, where there are obstacles, or balloons touch"""


@dataclass(frozen=True)
class Residence:
    """How the particles of a world live in the registers of a block."""

    particles_a_thread: int
    threads: int
    registers: int
    """of a thread"""
    blocks: int
    """that a multiprocessor runs at once"""
    rings: Ring | None
    """the quads around each particle, where area vectors come of them"""
    one_tile: bool
    """see `Layout`"""
    held: int
    """quads of membranes that threads have room for, see `FilmLayout`"""


def residence(model: Model, traits: Traits, ends: SpringEnds, film: FilmLayout | None) -> Residence | None:
    """The layout that lets most worlds run at once on a multiprocessor; None if the springs do not fit in registers.

    Two particles a thread share what a thread does for itself (spheres, barriers), and their loads overlap; where a
    multiprocessor has no second block to turn to while it waits, more threads with one particle each are faster. Where
    gas flows through tubes or out, all wait for the thread that finds how much: several small blocks bear that better.
    """
    if not (thread_a_particle(model) or film) or model.device.is_cpu or traits.gas_flows:
        return None
    if traits.membranes and (film is None or traits.wears or traits.aims):
        return None  # faces of membranes take the place in shared memory of what aims need
    rings = quad_rings(model) if traits.measures_areas or traits.aims_on_the_way else None
    single, double = (_best_of(model, traits, ends, rings, film, particles) for particles in (1, 2))
    if single and double:
        return double if double.blocks >= max(single.blocks, 2) else single
    return single or double


def _best_of(
    model: Model, traits: Traits, ends: SpringEnds, rings: Ring | None, film: FilmLayout | None, particles_a_thread: int
) -> Residence | None:
    """Threads hold quads where that leaves a multiprocessor a second block, if it has one otherwise."""
    reading, holding = (
        _residence(model, traits, ends, rings, film, particles_a_thread, held) for held in (False, True)
    )
    return holding if holding and reading and holding.blocks >= min(reading.blocks, 2) else reading


def _residence(
    model: Model,
    traits: Traits,
    ends: SpringEnds,
    rings: Ring | None,
    film: FilmLayout | None,
    particles_a_thread: int,
    holds_quads: bool,
) -> Residence | None:
    """With as many blocks as leave registers for the springs, and for so many others of a thread."""
    threads = -(-model.particle_count // (WARP_THREADS * particles_a_thread)) * WARP_THREADS
    quads = -(-model.face_count // threads) if holds_quads else 0
    slots = sum(kind_slots(ends)) * (3 if traits.springs_vary else 2)
    own = GAS_REGISTERS if traits.gas else OWN_REGISTERS
    if traits.membranes:
        own += FILM_REGISTERS
    if traits.stands_on_fixtures or traits.touches:
        own += CONTACT_REGISTERS
    needed = own + particles_a_thread * (24 + slots)
    one_tile = film is not None and not looks_late(traits, slots, film)
    words = (1 if one_tile else 2) * 3 * threads * particles_a_thread
    if film:
        words += (6 if film.areas else 4) * film_entries(model, film._replace(held=quads * threads))
    if holds_quads and not (film and film.areas and film.triangles == 4 and not traits.viscous and quads <= MOST_QUADS):
        return None
    needed += quads * QUAD_REGISTERS
    if threads > MOST_THREADS:
        return None
    for blocks in range(min(_useful_blocks(model, threads), _blocks_with(model, 4 * words)), 0, -1):
        warps_of_quarter = -(-blocks * threads // WARP_THREADS // QUARTERS)
        registers = min(REGISTERS // QUARTERS // WARP_THREADS // warps_of_quarter // 8 * 8, MOST_REGISTERS)
        if registers >= needed:
            return Residence(particles_a_thread, threads, registers, blocks, rings, one_tile, quads * threads)
    return None


def looks_late(traits: Traits, slots: int, film: FilmLayout) -> bool:
    """Whether points are looked at once some may have moved. Faces of membranes look sooner, before a barrier; not so
    who finds an area vector by itself, as where some faces are no quads, or are slack.

    Args:
        slots: of springs.
    """
    around = slots > 0 or traits.has("hinge") or traits.has("face") or traits.aims or traits.jets or traits.in_water
    around = around or (traits.measures_areas and not film.areas)
    beside = traits.touches or traits.spheres > 0 or (traits.obstacles and traits.frames == "free")
    return around or beside or traits.corrected or traits.looks_at_velocities


def _useful_blocks(model: Model, threads: int) -> int:
    """Blocks of a multiprocessor that there are worlds for, and that its threads allow."""
    return min(-(-model.world_count // model.device.sm_count), MOST_THREADS_OF_MULTIPROCESSOR // threads)


def _blocks_with(model: Model, tile_bytes: int) -> int:
    """Blocks that have shared memory for so large tiles, and for sums."""
    return model.device.max_shared_memory_per_block // (tile_bytes + SUM_BYTES)
