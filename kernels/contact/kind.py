"""Kinds of contacts: each finds its contacts, and lists them for a sweep; contact of particles with free bodies."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.bodies import Rigid, body_at, stop_function
from balloon_warp.kernels.loops.fixtures import friction_on, number_of_body
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, block_barrier
from balloon_warp.kernels.working import OF_CATCHES, Working, request_capacity

LISTED, MARKED = wp.constant(0), wp.constant(1)
"""Indices of the number of contacts that may act in this substep, and of those that come too near in a sweep"""
GIVEN = "t, state, working, world, thread, end, points, velocities"
"""Arguments of the functions that list contacts"""


class Kind(NamedTuple):
    """A kind of contacts."""

    is_active: Callable[[Features], bool]
    """Whether a scene has any"""
    list_all: Callable[[Features, bool], Any]
    """Function of `GIVEN` that lists the contacts of a substep by all threads of a block, and returns whether any of a
    thread overlaps; the second argument says whether substeps run backwards, so that none follows another"""
    max_sweeps: int
    """Largest number of sweeps in a substep; it ends sooner where nothing comes too near"""


class Sweep(NamedTuple):
    """Kinds of contacts that act at once, in the same sweeps."""

    kinds: tuple[Kind, ...]
    seen: Callable[[Features], Features]
    """Features that contacts see: those of other kinds cost nothing"""

    def of(self, features: Features) -> tuple[Kind, ...]:
        """Return the kinds that a scene has."""
        return tuple(kind for kind in self.kinds if kind.is_active(features))

    def most(self, features: Features) -> int:
        """Return the largest number of sweeps in a substep."""
        return max(kind.max_sweeps for kind in self.of(features))


@wp.func
def list_contact(working: Working, world: wp.int32, contact: Contact):
    """List a contact, in any order, and return whether its features overlap."""
    place = wp.atomic_add(working.listed_contact_counts, world, LISTED, 1)
    if place < working.listed_contacts.shape[1]:
        working.listed_contacts[world, place] = contact
    else:
        request_capacity(working, world, OF_CATCHES, place + 1, 1)
    return contact.overlap > 0.0


@cache
def sweep_listing(sweep: Sweep, features: Features, backwards: bool) -> Any:
    """Return the function that lists the contacts of all kinds in a substep.

    Args:
        backwards: as in `Kind.list_all`.
    """
    parts = {f"list_{number}": kind.list_all(features, backwards) for number, kind in enumerate(sweep.of(features))}
    arguments = ", ".join(f"{name}: Any" for name in GIVEN.split(", "))
    lines = (f"    overlaps = {name}({GIVEN}) or overlaps" for name in parts)
    source = "\n".join(
        [f"def list_kinds({arguments}):", "    overlaps = bool(False)", *lines, "    return overlaps", ""]
    )
    list_kinds = function_from("list_kinds", source, parts)

    @wp.func
    def list_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the number of contacts in a substep, and whether any overlaps, by all threads of a block."""
        if thread == 0:
            working.listed_contact_counts[world, LISTED] = 0
            working.listed_contact_counts[world, MARKED] = 0
        block_barrier()
        overlaps = any_in_block(list_kinds(t, state, working, world, thread, end, points, velocities))
        return wp.min(working.listed_contact_counts[world, LISTED], working.listed_contacts.shape[1]), overlaps

    return list_all


SETTLED, LITTLE = wp.constant(1.0e-3), wp.constant(1.0e-7)
"""Fractions of the way that a particle would go too far, and of the body's reach, by which it may still do so"""


@cache
def contact_function(features: Features) -> Any:
    """Detector of a particle's contact with a body; the normal is zero without one."""
    stop_at = stop_function(features)

    @wp.func
    def contact_of(t: Tables, world: wp.int32, rigid: Rigid, particle: wp.int32, point: wp.vec3, velocity: wp.vec3):
        contact = Contact()
        start = point - t.step_seconds * velocity
        stop = stop_at(
            t.bodies.solids[rigid.number], t.up, t.step_seconds, rigid, start, point, velocity, 0.0
        )  # fmt: skip
        contact.normal = stop.normal
        if wp.length_sq(stop.normal) > 0.0:
            approach = wp.dot(rigid.velocity + wp.cross(rigid.spin, stop.arm) - velocity, stop.normal)
            contact.ends = wp.vec4i(particle, particle, particle, particle)
            contact.weights = wp.vec4(1.0, 0.0, 0.0, 0.0)
            contact.gap = t.step_seconds * (approach - stop.excess)
            contact.left = SETTLED * t.step_seconds * wp.max(stop.excess, 0.0) + LITTLE * rigid.reach
            contact.overlap = stop.out
            contact.friction = friction_on(t, world, t.particles.balloon[particle], number_of_body(t, rigid.number))
            contact.solid = t.fixtures.solids.shape[0] + rigid.number
            contact.arm = stop.arm
        return contact

    return contact_of


@cache
def listing_function(features: Features, backwards: bool) -> Any:
    """Return the function that lists particles that would come into bodies, see `kind.Kind`."""
    contact_of = contact_function(features)

    @wp.func
    def list_bodies(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        overlaps = bool(False)
        for body in range(state.body_positions.shape[1]):
            rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
            for particle in range(thread, points.shape[0], wp.block_dim()):
                if t.particles.mass_share[particle] > 0.0:
                    contact = contact_of(t, world, rigid, particle, points[particle], velocities[particle])
                    if wp.length_sq(contact.normal) > 0.0:
                        overlaps = list_contact(working, world, contact) or overlaps
        return overlaps

    return list_bodies


BODIES = Kind(lambda features: features.bodies > 0, listing_function, 50)
"""Particles that would come into free bodies"""
