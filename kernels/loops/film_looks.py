"""Access of particles to the forces of membranes whose faces are measured once."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.film_places import FilmLayout
from balloon_warp.kernels.loops.films import films_of
from balloon_warp.kernels.loops.held_quads import quads_of
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.slots import Slots, slot_loop, springs_reader
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import in_tile
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


class FilmFunctions(NamedTuple):
    """Hold what phases ask for, see `phases.stretch`."""

    clear: Any
    stretch: Any
    collect: Any
    loops: Loops
    keeps: Any
    """Function that reads what a thread keeps of faces as a frame begins, if it keeps any"""


@cache
def kept_springs(traits: Traits, film: FilmLayout, slots: Slots) -> tuple[Any, Any]:
    """Return the type of what a particle keeps of its springs and faces, and the function that reads it."""
    Springs, read_springs = springs_reader(traits, slots)  # noqa: N806 - a type
    read_places = films_of(traits, film).read_places

    @wp.struct
    class Kept:
        """Springs, and where what faces do to the particle stands."""

        springs: Springs
        places: wp.vec4i

    @wp.func
    def read_kept(t: Tables, slot_table: Any, own: Any, place: wp.int32, active: bool):
        kept = Kept()
        kept.springs = read_springs(t, slot_table, own, place, active)
        kept.places = read_places(t, own, active)
        return kept

    return Kept, read_kept


@cache
def skin_functions(traits: Traits, film: FilmLayout, slots: Slots | None) -> tuple[Any, Any, Any]:
    """Return functions that collect membrane forces on a particle, and add them and area vectors to its springs' sums.

    The first collects, the second adds to the force, and the third returns the area vector.
    """
    take = films_of(traits, film).take
    kept_type: Any = springs_reader(traits, slots)[0] if slots else wp.int32
    pull_of_springs = slot_loop(traits, slots) if slots else spring_loop(traits, in_tile)
    has_springs = slots is None or sum(slots) > 0

    @wp.struct
    class Skin:
        """Membrane forces on a particle, and its springs."""

        springs: kept_type
        pull: wp.vec3
        area_vector: wp.vec3

    @wp.func
    def collect_kept(t: Tables, own: Any, springs: Any, pulls: Any, area_vectors: Any):
        skin = Skin()
        skin.springs = springs.springs
        pull, area_vector = take(t, own, springs.places, pulls, area_vectors)
        skin.pull = pull
        skin.area_vector = area_vector
        return skin

    @wp.func
    def collect(t: Tables, own: Any, pulls: Any, area_vectors: Any):
        skin = Skin()
        pull, area_vector = take(t, own, wp.vec4i(), pulls, area_vectors)
        skin.pull = pull
        skin.area_vector = area_vector
        return skin

    @wp.func
    def pull_of_skin(
        t: Tables, points: Any, velocities: Any, own: Any, skin: Any, point: wp.vec3, velocity: wp.vec3, time: float
    ):
        """Return the net force of springs and faces [N]."""
        if wp.static(has_springs):
            return pull_of_springs(t, points, velocities, own, skin.springs, point, velocity, time) + skin.pull
        else:
            return skin.pull

    @wp.func
    def area_vector_of_skin(t: Tables, points: Any, own: Any, skin: Any, point: wp.vec3):
        """Return the area vector of a particle [m^2]."""
        return skin.area_vector

    return collect_kept if slots else collect, pull_of_skin, area_vector_of_skin


@cache
def film_functions(traits: Traits, film: FilmLayout, slots: Slots | None) -> FilmFunctions:
    """Return the functions of faces, and of particles.

    Args:
        slots: of springs that particles keep, if they do.
    """
    films = films_of(traits, film)
    quads = quads_of(traits, film) if film.quads else None
    stretch_quads = quads.stretch if quads else None
    collect, pull, area_vector = skin_functions(traits, film, slots)

    @wp.func
    def stretch_kept(
        t: Tables,
        world: wp.int32,
        thread: wp.int32,
        numbers: Any,
        films: Any,
        points: Any,
        pulls: Any,
        area_vectors: Any,
    ):
        stretch_quads(t, world, thread, numbers, films, points, pulls, area_vectors)

    beside = traits._replace(membranes=())
    return FilmFunctions(
        films.clear,
        stretch_kept if quads else films.stretch,
        collect,
        scalar_loops(beside, in_tile, pull, area_vector if film.areas else None),
        quads.hold if quads else None,
    )
