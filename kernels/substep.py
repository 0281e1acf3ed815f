"""A substep, in order. Schedules place these pieces; what happens, and in which order, stands here.

    refresh      the aims of normal forces: once a frame, or every substep
    roll         spheres move under the contacts of the substep before             `loops.rolling`
    search       now and then: which balloons may touch, and where                  `schedules.touch_lists`
    press        balloons that touch push each other off                            `loops.meeting`, `laws.touch`
    wear         what is left of the tensions of rubber that softens                `loops.wear`
    pump         gas is pumped in, or let out                                       `loops.gas`
    pull         all forces on a particle but the inflation, jets among them        `loops.net_force`, `loops.jets`
    swell        where there is gas: how balloons would swell, and their pressure   `swell`, `load_of_balloon`
    flow         what flows through tubes and out meanwhile, by the pressures then  `loops.gas`
    push         the inflation                                                      `inflation`
    move         a = F / m; v += h a; x += h v (the paper's listing)                `kick`, `drift`
    correct      springs that are too long are shortened                            `laws.correction`
    touch        spheres and particles exchange momentum, if they do                `loops.touching`
    leave        particles leave spheres, by the paper's rule, obstacles and ground  `loops.obstacles`
    meet         bodies and particles, small spheres and faces, and sharp edges     `laws.edges`

Where no balloons touch, there is neither `search` nor `press`; what `press` finds acts with `push`, or with gas in
`pull`. Without gas, a particle goes from `pull` to `leave` by itself; with it, all wait for the pressure in between.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes, reach_along, scaled, times
from balloon_warp.kernels.compose import call_of, function_from
from balloon_warp.kernels.laws.gas import (
    Swelling,
    free_along,
    gas_load,
    memory_of_rate,
    rate_beside_obstacles,
    swelling_of_particle,
)
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE, normal_push
from balloon_warp.kernels.loops.obstacles import Around, course_function
from balloon_warp.kernels.memory import fixed_int_at, two_in
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@wp.func
def response(mass: float, step_seconds: float):
    """Velocity gained in a step for each newton [m/s/N]; a particle without mass is fixed."""
    return wp.where(mass > 0.0, step_seconds / mass, 0.0)


@wp.func_native(
    """
    wp::vec_t<8, wp::float32> gains;
    for (int lane = 0; lane < 8; ++lane)
        gains.c[lane] = mass.c[lane] > 0.0f ? step_seconds / mass.c[lane] : 0.0f;
    return gains;
    """
)
def response(mass: Lanes, step_seconds: float) -> Lanes:  # noqa: F811 - an overload
    """Of eight particles."""
    ...


@wp.func
def kick(velocity: Any, force: Any, gain: Any):
    """v + h F / m; the gain is h / m, see `response`."""
    return velocity + scaled(force, gain)


@wp.func
def drift_symplectic(point: Any, old_velocity: Any, velocity: Any, step_seconds: float):
    """x + h v, v the new velocity: symplectic Euler, in the order of the paper's listing."""
    return point + scaled(velocity, step_seconds)


@wp.func
def drift_forward(point: Any, old_velocity: Any, velocity: Any, step_seconds: float):
    """x + h v, v the old velocity: forward Euler."""
    return point + scaled(old_velocity, step_seconds)


def drift_of(traits: Traits) -> Any:
    """The function that moves a point."""
    return drift_forward if traits.forward_euler else drift_symplectic


@wp.func
def pressure_at(load: Any, rise: Any, point: Any, up: wp.vec3):
    """At a place [Pa], see `inflation_of`."""
    return load + times(rise, reach_along(point, up))


@cache
def inflation_of(traits: Traits) -> Any:
    """The function that gives the force of the inflation on a particle, or on eight of a balloon."""

    @wp.func
    def inflation(kind: wp.int32, k_normal: Any, load: Any, rise: Any, up: wp.vec3, point: Any, aim: Any, area: Any):
        """[N]

        Args:
            load: pressure at height 0 [Pa].
            rise: of the pressure with height [Pa/m].
        """
        if wp.static(not traits.pressures):
            return scaled(aim, normal_push(k_normal))
        elif wp.static(not traits.aims):
            return scaled(area, pressure_at(load, rise, point, up))
        else:
            push = pressure_at(load, rise, point, up)
            along = area
            if kind == NORMAL_FORCE:
                push = normal_push(k_normal)
                along = aim
            return scaled(along, push)

    return inflation


@cache
def memory_function(traits: Traits) -> Any:
    """The function that gives what of a velocity before the step counts in a balloon's swelling; of a balloon's
    breathing_damping, where one breathes on."""

    @wp.func
    def remembered(velocity: wp.vec3, n: Any):
        if wp.static(traits.breathes_on):
            return memory_of_rate(n[wp.static(traits.columns.places["breathing_damping"])]) * velocity
        else:
            return wp.vec3()

    return remembered


@cache
def swell_function(traits: Traits, sphere_at: Any) -> Any:
    """The function that gives a particle's part of its balloon's swelling."""
    course_beside_obstacles = course_function(traits, sphere_at)

    @wp.func
    def swell(
        t: Tables,
        spheres: Any,
        around: Around,
        share: float,
        gain: float,
        load: wp.vec2,
        arm: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
        remembered: wp.vec3,
        area_vector: wp.vec3,
    ):
        """Beside obstacles under the old load; the velocity is that without inflation.

        Args:
            gain: see `response`.
            arm: from a point of the balloon's own [m].
            remembered: what of the velocity before the step counts, see `memory_function`.
        """
        height = wp.dot(point, t.up)
        free = area_vector
        rate = float(0.0)
        if wp.static(traits.obstacles):
            push = load[0] + load[1] * height
            course = velocity + (gain * push) * area_vector
            if gain > 0.0:
                let, normal = course_beside_obstacles(t, spheres, around, point, course)
                course = let
                free = free_along(area_vector, normal)
            rate = rate_beside_obstacles(area_vector, free, course - remembered, gain, push)
        else:
            rate = wp.dot(area_vector, velocity - remembered)
        return swelling_of_particle(arm, area_vector, free, rate, gain, share, height)

    return swell


@cache
def load_function(traits: Traits) -> Any:
    """The function that gives a balloon's pressure above the air's at its center of mass [Pa], at height 0, its rise
    with height [Pa/m], and how more gas would raise it, of its swelling, its gas and the step."""
    given = ["swelling", "amount", "free_volume", "step_seconds"]
    fixed = {} if traits.breathes_on else {"breathing_damping": "1.0"}
    if not traits.air_varies:
        fixed["air_lapse"] = "-1.0"
    call = call_of(gas_load, "gas_load", [*given, *fixed], traits.columns, lambda name: fixed.get(name, name))
    arguments = "swelling: Any, amount: float, free_volume: float, step_seconds: float, n: Any"
    source = f"def load_of_gas({arguments}):\n    return {call}\n"
    load_of_gas = function_from("load_of_gas", source, {"gas_load": gas_load})

    @wp.func
    def load_of_balloon(
        kind: wp.int32,
        given: float,
        swelling: Swelling,
        amount: float,
        free_volume: float,
        step_seconds: float,
        n: Any,
    ):
        """`given` is the pressure of what is no gas [Pa]."""
        if kind == GAS:
            return load_of_gas(swelling, amount, free_volume, step_seconds, n)
        return wp.vec4(given, given, 0.0, 0.0)

    return load_of_balloon


@cache
def note_function(traits: Traits) -> Any:
    """The function that notes a load in the state."""

    @wp.func
    def note_load(state: WorldState, world: wp.int32, balloon: wp.int32, load: wp.vec4):
        """By one thread."""
        state.pressures[world, balloon] = load[0]
        state.inflation_loads[world, balloon] = wp.vec2(load[1], load[2])
        if wp.static(traits.gas_flows):
            state.pressure_slopes[world, balloon] = load[3]

    return note_load


@wp.func
def time_of(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """Since the simulation began [s]."""
    return float(frame[0]) * t.frame_seconds + time_in_frame


@wp.func
def end_of_step(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """When a substep ends that begins at a time in the frame [s]."""
    return time_of(t, frame, time_in_frame) + t.step_seconds


@wp.func
def volume_origin(t: Tables, balloon: wp.int32):
    """The particle of a balloon about which its volume is taken."""
    return fixed_int_at(t.faces.volume_origins, balloon)


@wp.func
def ramp_at(state: WorldState, world: wp.int32, balloon: wp.int32, time_in_frame: float):
    """What is keyframed, such as k_normal, at a time of the frame."""
    ramp = two_in(state.inflation_ramp, world, balloon)
    return ramp[0] + ramp[1] * time_in_frame
