"""The courses of spheres in a substep, found again: each change of one is noted, with the course before it."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.fixed_point import total_newtons
from balloon_warp.kernels.loops.colliding import colliding_function
from balloon_warp.kernels.loops.rolling import Course, course_of, put_course, rolling_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass

EVENTS_OF_A_SPHERE = 96
"""Room for changes of courses in a substep, for each sphere of a world"""


@wp.struct
class Event:
    """A change of a sphere's course."""

    kind: wp.int32  # see `loops.rolling`
    first: wp.int32  # the sphere
    second: wp.int32  # the other sphere, or the number of an obstacle
    mine: Course
    other: Course


@wp.struct
class LoggedSpheres:
    """Spheres of all worlds as a substep moves them, shape (W, S), and the events that change their courses."""

    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_spins: wp.array2d[wp.vec3]
    sphere_starts: wp.array2d[wp.vec3]
    events: wp.array2d[Event]
    counts: wp.array[wp.int32]
    """Number of events of each world; those beyond the room are not there"""


@wp.func
def note_event(
    spheres: LoggedSpheres, world: wp.int32, kind: wp.int32, first: wp.int32, second: wp.int32, mine: Course,
    other: Course,
):  # fmt: skip
    """Note an event that changes a course, or two."""
    place = spheres.counts[world]
    if place < spheres.events.shape[1]:
        event = Event()
        event.kind = kind
        event.first = first
        event.second = second
        event.mine = mine
        event.other = other
        spheres.events[world, place] = event
    spheres.counts[world] = place + 1


@cache
def roll_again_kernel(features: Features) -> Any:
    """Return the kernel that moves spheres again, and notes the events that change their courses."""
    course_after = rolling_function(features, note_event)
    collide_all = colliding_function(features, note_event)
    split = features.columns.balloon_width
    gravity, height, restitution = (
        features.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def roll_again(
        t: Tables, before: WorldState, quanta: wp.array3d[wp.int64], time_in_frame: float, spheres: LoggedSpheres
    ):
        """Move the spheres of a world; a thread a world.

        Args:
            quanta: forces on spheres since they last moved, as the substep began.
        """
        world = wp.tid()
        end = time_in_frame + t.step_seconds
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        around = wp.vec3(numbers[gravity], numbers[height], numbers[restitution])
        spheres.counts[world] = 0
        for sphere in range(t.spheres.numbers.shape[1]):
            course = course_of(
                before.sphere_positions[world, sphere],
                before.sphere_velocities[world, sphere],
                before.sphere_spins[world, sphere],
            )
            spheres.sphere_starts[world, sphere] = course.position
            pushed = wp.vec3()
            if wp.static(features.penalties):
                pushed = total_newtons(quanta, world, sphere) / sphere_mass(t.spheres, world, sphere)
            course = course_after(t, spheres, world, sphere, end, course, pushed, around)
            put_course(spheres, world, sphere, course, True)
        if wp.static(features.spheres_meet):
            collide_all(t, spheres, world, end)

    return roll_again
