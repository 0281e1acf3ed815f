"""Layout of a world on a block of threads: registers, shared memory, and the number of threads."""

from balloon_warp.kernels.loops.film_places import FilmLayout
from balloon_warp.kernels.phases.check import check
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.looks import look_of
from balloon_warp.kernels.schedules.pieces import Step, cut
from balloon_warp.kernels.substep import FACING, FILMED, NOTHING, phases_of
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.schedules.block_room import CAPACITY_STEP, MOST_THREADS, most_particles, thread_a_particle
from balloon_warp.schedules.films import film_entries, film_layout
from balloon_warp.schedules.rings import least_valence, quad_rings
from balloon_warp.schedules.slots import kind_slots
from balloon_warp.schedules.spring_ends import spring_ends

WARP_THREADS = 32
MOST_THREADS_OF_MULTIPROCESSOR = 2048
REGISTERS = 65536
"""Registers of a multiprocessor"""
QUARTERS = 4
"""Partitions of a multiprocessor, among which its warps and registers are divided"""
MOST_REGISTERS = 248
"""Largest number of registers of a thread"""
OWN_REGISTERS, GAS_REGISTERS, FIXTURE_REGISTERS = 12, 28, 28
"""Registers of a thread besides those for particles: without gas, with gas, and additional ones for obstacles"""
PARTICLE_REGISTERS = 24
"""Registers for a particle, besides those for its springs"""
FILM_REGISTERS, QUAD_REGISTERS = 4, 20
"""Additional registers to measure a face of a membrane, and for each quad that a thread keeps"""
MOST_QUADS = 2
"""Largest number of quads that a thread keeps"""
SUM_BYTES = 2048
"""Shared memory of a block besides tiles [bytes]"""
POINT_BYTES = 12
THREADS_BESIDE = ((416, 72), (384, 80), (256, 80))
"""Threads of a block that loop over particles, and registers of each, where a multiprocessor has memory for two such
blocks; chosen is the one whose last turn is fullest"""
THREADS_OF_MANY, MANY = (512, 64), 1792
"""Threads and registers from a number of particles of one balloon of springs"""
THREADS_NEAR_FIXTURES = 256, 128
"""Threads and registers where particles touch obstacles, which takes more registers"""
THREADS_ALONE = 768, 80
"""Threads and registers where a multiprocessor has memory for one block only"""


def step_of(traits: Traits, layout: Layout) -> Step:
    """Return the phases of a scene, in pieces, as a block executes them."""
    instead = FILMED if layout.film else FACING if traits.aims_on_the_way else NOTHING
    phases = (*phases_of(traits, instead=instead), *phases_of(traits, (check,)))
    return cut(phases, traits, look_of(layout, traits.spheres), doubles=True, sums_along=True)


def layout_of(model: Model, traits: Traits) -> Layout:
    """Return the layout that lets most worlds run at once on a multiprocessor.

    A thread keeps one particle, or two, if their springs fit in registers; otherwise it loops. Two share what a thread
    does for itself, and their loads overlap; where a multiprocessor has no second block to turn to while it waits, more
    threads with one particle each are faster.
    """
    single, double = (_held(model, traits, count) for count in (1, 2))
    if single and double:
        return double[0] if double[1] >= max(single[1], 2) else single[0]
    return (single or double or (_looped(model, traits), 0))[0]


def _held(model: Model, traits: Traits, held: int) -> tuple[Layout, int] | None:
    """Return the layout with so many particles a thread, and how many blocks a multiprocessor then runs at once."""
    film = film_layout(model, traits)
    if model.device.is_cpu or not (thread_a_particle(model) or film) or traits.gas_flows or traits.corrected:
        return None
    if traits.membranes and (film is None or traits.wears or traits.aims):
        return None
    reading, keeping = (_with_quads(model, traits, held, film, keeps) for keeps in (False, True))
    return keeping if keeping and reading and keeping[1] >= min(reading[1], 2) else reading


def _with_quads(
    model: Model, traits: Traits, held: int, film: FilmLayout | None, keeps_quads: bool
) -> tuple[Layout, int] | None:
    """Return the layout with threads that keep quads of membranes, or none."""
    threads = _round_up(-(-model.particle_count // held), WARP_THREADS)
    capacity, quads = threads * held, -(-model.face_count // threads) if keeps_quads else 0
    may_keep = film and film.areas and film.triangles == 4 and not traits.viscous and quads <= MOST_QUADS
    if threads > MOST_THREADS or (keeps_quads and not may_keep):
        return None
    if film:
        film = film._replace(quads=quads, room=quads * threads, capacity=capacity)
        film = film._replace(tile=film_entries(model, film))
    ends = spring_ends(model)
    ring = quad_rings(model) if traits.measures_areas or traits.aims_on_the_way else None
    layout = Layout(
        threads, capacity, held, kind_slots(ends), least_valence(ring) if ring else 0, film=film,
        odd=model.substeps % 2 == 1,
    )  # fmt: skip
    tiles = 2 if "point" in step_of(traits, layout).doubled else 1
    bytes_of_tiles = tiles * POINT_BYTES * capacity + (film.tile * (24 if film.areas else 16) if film else 0)
    slots = sum(layout.slots) * (3 if traits.springs_vary else 2)
    needed = (GAS_REGISTERS if traits.gas else OWN_REGISTERS) + held * (PARTICLE_REGISTERS + slots)
    needed += FILM_REGISTERS * bool(film) + quads * QUAD_REGISTERS
    needed += FIXTURE_REGISTERS if traits.stands_on_fixtures else 0
    in_memory = model.device.max_shared_memory_per_block // (bytes_of_tiles + SUM_BYTES)
    useful = min(-(-model.world_count // model.device.sm_count), MOST_THREADS_OF_MULTIPROCESSOR // threads)
    for blocks in range(min(useful, in_memory), 0, -1):
        warps_of_quarter = -(-blocks * threads // WARP_THREADS // QUARTERS)
        registers = min(REGISTERS // QUARTERS // WARP_THREADS // warps_of_quarter // 8 * 8, MOST_REGISTERS)
        if registers >= needed:
            return layout._replace(registers=registers), blocks
    return None


def _looped(model: Model, traits: Traits) -> Layout:
    """Return the layout in which threads loop over particles.

    Values that wait from piece to piece do so in shared memory, as far as two blocks have room for them.
    """
    film = film_layout(model, traits)
    threads, registers = _loop_threads(model, traits, film)
    threads = 1 if model.device.is_cpu else min(_round_up(model.particle_count, WARP_THREADS), threads)
    capacity = _round_up(model.particle_count, CAPACITY_STEP)
    layout = Layout(
        threads, capacity, registers=registers, odd=model.substeps % 2 == 1,
        film=film._replace(areas=False) if film else None,  # from memory they are no sooner read than found
    )  # fmt: skip
    return _ordered(traits, layout._replace(tiles=_tiles(model, traits, layout)))


def _ordered(traits: Traits, layout: Layout) -> Layout:
    """Return the layout with particles by their number of springs, where only this kernel sees them in that order."""
    alone = "velocity" in layout.tiles and not (traits.membranes or traits.has("hinge") or traits.keeps)
    return layout._replace(ordered=alone)


def _loop_threads(model: Model, traits: Traits, film: FilmLayout | None) -> tuple[int, int]:
    """Return the threads that loop, and registers of each."""
    if 2 * model.particle_count > most_particles(model):
        return THREADS_ALONE
    if traits.stands_on_fixtures:
        return THREADS_NEAR_FIXTURES
    if model.balloon_count == 1 and film is None and model.particle_count > MANY:
        return THREADS_OF_MANY
    return min(THREADS_BESIDE, key=lambda each: _round_up(model.particle_count, each[0]))


def _tiles(model: Model, traits: Traits, layout: Layout) -> tuple[str, ...]:
    """Return the state of particles in shared memory, besides points."""
    if model.device.is_cpu:
        return ()
    step = step_of(traits, layout)
    kept = [value for value in ("area_vector", "free_velocity", "force", "aim") if value in step.kept]
    velocities_are_seen = traits.looks_at_velocities or traits.needs("face", "velocity") or traits.impulses
    waiting = [*([] if velocities_are_seen else ["velocity"]), *kept]
    points = 2 if "point" in step.doubled else 1
    room = most_particles(model, POINT_BYTES) // (1 if traits.corrected else 2) // layout.capacity - points
    return tuple(waiting[: max(room, 0)])


def _round_up(count: int, step: int) -> int:
    return -(-count // step) * step
