"""Adjoint of a sphere and corners of faces that move on as one.

With masses m, ways d and velocities v of all, all have the mean way D and velocity V. So with the sum b of the
derivatives by places after it, those by d are m b / M of the mass M of all, and by m they are (d - D) . b / M.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.face_log import LoggedFaces
from balloon_warp.kernels.adjoints.sphere_bars import add_by_sphere, bar_of_course, put_bar_of_course
from balloon_warp.kernels.contact.faces import add_to_lump
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.net_force import inertia_function
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables, sphere_mass
from balloon_warp.kernels.working import Working


@wp.func
def lump_again(working: Working, spheres: LoggedFaces, world: wp.int32, place: wp.int32):
    """Find the particles of a lump again, up to one of its contacts, and return their number."""
    first = place
    while spheres.contacts[world, first].lumped > 0:
        first -= 1
    count = wp.int32(0)
    for each in range(first, place + 1):
        count = add_to_lump(working.lumps[world], count, spheres.contacts[world, each].corners)
    return count


@cache
def lump_adjoint(features: Features) -> Any:
    """Return the function that runs a contact of a lump backwards, by one thread."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def lump_back(
        t: Tables, working: Working, spheres: LoggedFaces, bars: Any, world: wp.int32, place: wp.int32
    ):  # fmt: skip
        """Turn the derivatives by a lump into those by the sphere and corners that came to it.

        Args:
            spheres: as the contact has left them.
        """
        contact = spheres.contacts[world, place]
        sphere = contact.sphere
        start = working.sphere_starts[world, sphere]
        way = spheres.sphere_positions[world, sphere] - start
        velocity = spheres.sphere_velocities[world, sphere]
        count = lump_again(working, spheres, world, place)
        bar = bar_of_course(bars.spheres, world, sphere)
        by_way = bar.position
        by_velocity = bar.velocity
        heavy = sphere_mass(t.spheres, world, sphere)
        mass = heavy
        held = bool(False)
        for member in range(count):
            particle = working.lumps[world, member]
            by_way += bars.points[world, particle]
            by_velocity += bars.velocities[world, particle]
            its_mass = inertia(working, read_params(t, world, particle))
            held = held or its_mass == 0.0
            mass += its_mass
        ease = wp.where(held, 0.0, 1.0 / mass)
        came = contact.course.position - start  # its members so far came with the sphere
        going = contact.course.velocity
        by_mass = ease * (wp.dot(came - way, by_way) + wp.dot(going - velocity, by_velocity))
        add_by_sphere(bars.spheres, world, sphere, by_mass, 0.0)
        bars.spheres.starts[world, sphere] = bars.spheres.starts[world, sphere] + bar.position - ease * heavy * by_way
        bar.position = ease * heavy * by_way
        bar.velocity = ease * heavy * by_velocity
        put_bar_of_course(bars.spheres, world, sphere, bar)
        for member in range(count):
            particle = working.lumps[world, member]
            its_way = came
            its_velocity = going
            if member >= contact.lumped:
                for corner in range(3):
                    if contact.corners[corner] == particle:
                        its_way = contact.points[corner] - working.point_starts[world, particle]
                        its_velocity = contact.velocities[corner]
            its_mass = inertia(working, read_params(t, world, particle))
            of_way = ease * its_mass * by_way
            by_mass = ease * (wp.dot(its_way - way, by_way) + wp.dot(its_velocity - velocity, by_velocity))
            bars.starts[world, particle] = bars.starts[world, particle] + bars.points[world, particle] - of_way
            bars.points[world, particle] = of_way
            bars.velocities[world, particle] = ease * its_mass * by_velocity
            bars.eases[world, particle] = bars.eases[world, particle] - by_mass * its_mass * its_mass

    return lump_back
