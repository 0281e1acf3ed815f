"""Adjoint of small spheres that meet faces, a block a world.

A substep's contacts are resolved again, and each is noted, see `face_log`. Then one thread goes through them from the
last to the first: each turns the derivatives by a sphere and corners after it into those by their states before it. So
all adds up in one order. Frozen is which faces a sphere meets, in which order, and with which it moves on as one.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.face_log import ALONE, FaceContact, LoggedFaces, note_contact
from balloon_warp.kernels.adjoints.lumps import lump_adjoint
from balloon_warp.kernels.adjoints.one_impact import (
    Coming,
    Worth,
    facing_when,
    impact_work,
    sum_of_comings,
    work_of_look,
)
from balloon_warp.kernels.adjoints.particle_sums import weighing_function
from balloon_warp.kernels.adjoints.sphere_bars import (
    BarsOfSpheres,
    add_by_friction,
    add_by_sphere,
    bar_of_course,
    put_bar_of_course,
)
from balloon_warp.kernels.contact.faces import corner_rows, faces_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.touch import longest_way, part_after, part_until_contact, seen_at
from balloon_warp.kernels.loops.fixtures import friction_between, number_of_balloon, number_of_sphere
from balloon_warp.kernels.loops.net_force import ease_function
from balloon_warp.kernels.loops.spheres import put_course
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import Adjoint, Look, Phase
from balloon_warp.kernels.tables import Tables, sphere_mass, sphere_radius
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working


@wp.struct
class FaceBars:
    """Derivatives by small spheres and faces that meet."""

    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    starts: wp.array2d[wp.vec3]
    """Derivatives by the places of particles before the substep"""
    eases: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    spheres: BarsOfSpheres
    parts: wp.array2d[float]
    """Parts of the step at which a contact was looked for, shape (W, looks)"""


def small_spheres_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of small spheres and faces: a kernel of its own runs them backwards."""
    return ()


@cache
def coming_function(features: Features) -> Any:
    """Return the function that reads all that a contact depends on."""
    ease_of_moving = ease_function(features)

    @wp.func
    def coming_of(t: Tables, working: Working, world: wp.int32, contact: FaceContact):
        corners = contact.corners
        coming = Coming()
        coming.start = working.sphere_starts[world, contact.sphere]
        coming.course = contact.course
        coming.radius = sphere_radius(t.spheres, world, contact.sphere)
        coming.mass = sphere_mass(t.spheres, world, contact.sphere)
        coming.starts = corner_rows(working.point_starts[world], corners)
        coming.points = contact.points
        coming.velocities = contact.velocities
        for corner in range(3):
            coming.eases[corner] = ease_of_moving(t, working, world, corners[corner])
        if wp.static(features.spheres_rub):
            balloon = number_of_balloon(t, t.particles.balloon[corners[0]])
            coming.friction = friction_between(t, world, balloon, number_of_sphere(t, contact.sphere))
        return coming

    return coming_of


@wp.func
def looks_back(coming: Coming, nearest: float, looks: wp.int32, by_part: float, parts: wp.array[float]):
    """Return the derivatives by all that the time of impact was found from."""
    facing = facing_when(coming)
    longest = longest_way(facing)
    part = float(0.0)
    for look in range(looks - 1):
        parts[look] = part
        _weights, arm = seen_at(facing, part)
        part = part_after(part, wp.length(arm), nearest * facing.radius, longest)
    found = Coming()
    look = looks - 1
    while look > 0:
        look -= 1
        by_coming, by_earlier, _nearest, _by = wp.grad(work_of_look)(coming, parts[look], nearest, by_part)
        found = sum_of_comings(found, by_coming)
        by_part = by_earlier
    return found


@cache
def contact_adjoint(features: Features) -> Any:
    """Return the function that runs a contact backwards, by one thread."""
    coming_of, work_of_impact = coming_function(features), impact_work(features)

    @wp.func
    def contact_back(t: Tables, working: Working, bars: FaceBars, world: wp.int32, contact: FaceContact):
        coming = coming_of(t, working, world, contact)
        sphere = contact.sphere
        corners = contact.corners
        bar = Worth()
        bar.course = bar_of_course(bars.spheres, world, sphere)
        bar.points = corner_rows(bars.points[world], corners)
        bar.velocities = corner_rows(bars.velocities[world], corners)
        facing = facing_when(coming)
        part, looks = part_until_contact(facing, contact.nearest * facing.radius)
        found, by_part, _step, _bar = wp.grad(work_of_impact)(coming, part, t.step_seconds, bar)
        found = sum_of_comings(found, looks_back(coming, contact.nearest, looks, by_part, bars.parts[world]))
        put_bar_of_course(bars.spheres, world, sphere, found.course)
        bars.spheres.starts[world, sphere] = bars.spheres.starts[world, sphere] + found.start
        add_by_sphere(bars.spheres, world, sphere, found.mass, found.radius)
        if wp.static(features.spheres_rub):
            balloon = number_of_balloon(t, t.particles.balloon[corners[0]])
            add_by_friction(bars.spheres, world, balloon, number_of_sphere(t, sphere), found.friction)
        for corner in range(3):
            particle = corners[corner]
            bars.points[world, particle] = found.points[corner]
            bars.velocities[world, particle] = found.velocities[corner]
            bars.starts[world, particle] = bars.starts[world, particle] + found.starts[corner]
            bars.eases[world, particle] = bars.eases[world, particle] + found.eases[corner]

    return contact_back


@cache
def faces_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs small spheres and faces backwards, after it has let them meet again.

    Args:
        columns: of the numbers that are derived by.
    """
    meet_again, lump_back = faces_function(features, note_contact), lump_adjoint(features)
    contact_back, weigh_back = contact_adjoint(features), weighing_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_faces_back(
        t: Tables, working: Working, spheres: LoggedFaces, all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], bars: FaceBars,
    ):  # fmt: skip
        """Turn the derivatives by the state after contacts into those by the state before; a block a world.

        Args:
            spheres: as they come to faces; they are moved again, as are the next two.
        """
        world, thread = wp.tid()
        if thread == 0:
            spheres.counts[world] = 0
        block_barrier()
        meet_again(t, spheres, working, world, thread, all_points[world], all_velocities[world])
        block_barrier()
        if thread == 0:
            count = spheres.counts[world]
            while count > 0:
                count -= 1
                contact = spheres.contacts[world, count]
                if contact.lumped == ALONE:
                    contact_back(t, working, bars, world, contact)
                else:
                    lump_back(t, working, spheres, bars, world, count)
                put_course(spheres, world, contact.sphere, contact.course, True)
        block_barrier()
        if spheres.counts[world] > 0:
            for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                weigh_back(t, working, bars, world, particle)

    return turn_faces_back


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def add_by_starts(bars: FaceBars):
    """Add the derivatives by a particle's place before the substep to those by where the substep begins."""
    world, particle = wp.tid()
    bars.points[world, particle] = bars.points[world, particle] + bars.starts[world, particle]
    bars.starts[world, particle] = wp.vec3()
