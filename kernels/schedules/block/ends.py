"""What faces of membranes do to the particles of a thread, in a block. Where a thread has a pair of quads and the
particles at the ends of the edge that these share, what the pair does to them stays in its registers."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.areas import CROSSES
from balloon_warp.kernels.memory import found_anew
from balloon_warp.kernels.schedules.block.film_places import film_places
from balloon_warp.kernels.schedules.block.films import Films
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.schedules.block.pairs import Ends, pairs_of
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


@cache
def stretch_function(traits: Traits, layout: Layout, films: Films, member: Any) -> Any:
    """The function that measures all faces and hands a thread's particles what these do to them; with a barrier.

    Args:
        member: the type of a particle.
    """
    assert layout.film is not None
    two, slots, own_slots, pair_count = layout.two, layout.film.slots, layout.film.own_slots, layout.film.pairs
    Member = member  # noqa: N806 - a type

    @wp.func
    def stretch_anyhow(
        t: Tables, seat: Seat, mine: Member, also: Member, points: Any, velocities: Any, pulls: Any, areas: Any
    ):
        films.stretch(t, seat, mine.own.n, mine.springs, points, velocities, pulls, areas)
        mine.springs = films.take(t, seat, mine.own.number, mine.springs, pulls, areas)
        if wp.static(two):
            also.springs = films.take(t, seat, also.own.number, also.springs, pulls, areas)
        return mine, also

    if not own_slots:
        return stretch_anyhow
    pairs, get = pairs_of(traits, layout), film_places(layout).get
    measure, end_of = pairs.stretch_ends, pairs.end_of

    @wp.func
    def take(places: wp.vec4i, pulls: Any, areas: Any):
        """What pairs do to a particle, but for its own."""
        pull, area_vector = get(pulls, areas, found_anew(places[0]))
        for slot in range(1, own_slots):
            more, further = get(pulls, areas, found_anew(places[slot]))
            pull += more
            area_vector += further
        return pull, area_vector

    @wp.func
    def take_both(thread: wp.int32, mine: wp.vec4i, also: wp.vec4i, has_both: bool, ends: Ends, pulls: Any, areas: Any):
        """Most threads have both ends. Some have the first alone, and some without a pair another particle."""
        pull, area_vector = take(mine, pulls, areas)
        if has_both:
            other_pull, other_area_vector = take(also, pulls, areas)
            return (
                pull + ends.pull_b, area_vector + ends.area_b,
                other_pull + ends.pull_c, other_area_vector + ends.area_c,
            )  # fmt: skip
        if thread < pair_count:
            return pull + ends.pull_b, area_vector + ends.area_b, wp.vec3(), wp.vec3()
        for slot in range(own_slots, slots):
            more, further = get(pulls, areas, mine[slot])
            pull += more
            area_vector += further
        return pull, area_vector, wp.vec3(), wp.vec3()

    @wp.func
    def stretch(
        t: Tables, seat: Seat, mine: Member, also: Member, points: Any, velocities: Any, pulls: Any, areas: Any
    ):
        """Where there is no second particle, its point is that of the pair's second end."""
        held = mine.springs
        also.point = end_of(points, held.quads, also.point, also.active)
        ends = measure(t, seat, mine.own.n, held.quads, mine.point, also.point, also.active, points, pulls, areas)
        pull, area, other_pull, other_area = take_both(
            seat.thread, held.places, also.springs.places, also.active, ends, pulls, areas
        )
        mine.springs.pull = pull
        mine.springs.area_vector = CROSSES * area
        also.springs.pull = other_pull
        also.springs.area_vector = CROSSES * other_area
        return mine, also

    return stretch
