"""A substep, in order. Schedules place these pieces; what happens, and in which order, stands here.

    refresh      the aims of normal forces: once a frame, or every substep
    roll         spheres move under the contacts of the substep before             `laws.contact.move_sphere`
    flow         gas is pumped, let out, flows through tubes                        `flow_of_gas`
    pull         all forces on a particle but the inflation                         `loops.net_force`
    swell        where there is gas: how balloons would swell, and their pressure   `swell`, `load_of_balloon`
    push         the inflation                                                      `inflation`
    move         a = F / m; v += h a; x += h v (the paper's listing)                `kick`, `drift`
    correct      springs that are too long are shortened                            `laws.correction`
    touch        spheres and particles exchange momentum, if they do                `loops.touching`
    leave        particles leave spheres, by the paper's rule, and the ground       `loops.obstacles`

Without gas, a particle goes from `pull` to `leave` by itself; with it, all wait for the pressure in between.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes, reach_along, scaled, times
from balloon_warp.kernels.compose import call_of, function_from
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.laws.gas import Swelling, gas_load, swelling_of_particle, tube_flow
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE, normal_push
from balloon_warp.kernels.loops.obstacles import course_function
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
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
def kick(velocity: Any, force: Any, mass: Any, step_seconds: float):
    """v + h F / m"""
    return velocity + scaled(force, response(mass, step_seconds))


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
            return scaled(area, load + times(rise, reach_along(point, up)))
        else:
            push = load + times(rise, reach_along(point, up))
            along = area
            if kind == NORMAL_FORCE:
                push = normal_push(k_normal)
                along = aim
            return scaled(along, push)

    return inflation


@cache
def swell_function(traits: Traits, sphere_at: Any) -> Any:
    """The function that gives a particle's part of its balloon's swelling."""
    course_beside_obstacles = course_function(traits, sphere_at)

    @wp.func
    def swell(
        t: Tables,
        spheres: Any,
        world: wp.int32,
        ground_height: float,
        share: float,
        mass: float,
        load: wp.vec2,
        arm: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
        area_vector: wp.vec3,
    ):
        """Under the old load; the velocity is that without inflation.

        Args:
            arm: from a point of the balloon's own [m].
        """
        height = wp.dot(point, t.up)
        push = load[0] + load[1] * height
        course = velocity + (response(mass, t.step_seconds) * push) * area_vector
        normal = wp.vec3()
        if mass > 0.0:
            let, away = course_beside_obstacles(t, spheres, world, ground_height, point, course)
            course = let
            normal = away
        return swelling_of_particle(arm, area_vector, course, normal, mass, share, height, push, t.step_seconds)

    return swell


@cache
def load_function(columns: Columns) -> Any:
    """The function that gives a balloon's pressure above the air's at its center of mass [Pa], at height 0, and its
    rise with height [Pa/m], of its swelling, its gas and the step."""
    call = call_of(gas_load, "gas_load", ["swelling", "amount", "step_seconds"], columns)
    source = f"def load_of_gas(swelling: Any, amount: float, step_seconds: float, n: Any):\n    return {call}\n"
    load_of_gas = function_from("load_of_gas", source, {"gas_load": gas_load})

    @wp.func
    def load_of_balloon(kind: wp.int32, given: float, swelling: Swelling, amount: float, step_seconds: float, n: Any):
        """`given` is the pressure of what is no gas [Pa]."""
        if kind == GAS:
            return load_of_gas(swelling, amount, step_seconds, n)
        return wp.vec3(given, given, 0.0)

    return load_of_balloon


@wp.func
def pumped_amount(amount: wp.float64, ramp: wp.vec2, time_in_frame: float, step_seconds: float):
    """Gas after a substep in which it is pumped in or let out [mol], `ramp[0]` mol/s at the start of the frame."""
    pumped = step_seconds * (ramp[0] + ramp[1] * (time_in_frame + 0.5 * step_seconds))
    return wp.max(amount + wp.float64(pumped), wp.float64(0.0))


@cache
def flow_function(columns: Columns) -> Any:
    """The function that moves gas."""
    gamma = columns.places["gamma"]
    air_pressure = columns.places["air_pressure"] - columns.balloon_width

    @wp.func
    def flow_of_gas(
        t: Tables,
        ramps: wp.array[wp.vec2],
        pressures: wp.array[float],
        amounts: wp.array[wp.float64],
        world: wp.int32,
        time_in_frame: float,
    ):
        """By one thread of a world, whose rows the arrays are: what is pumped, and what flows through tubes."""
        for balloon in range(t.inflation_kind.shape[0]):
            if t.inflation_kind[balloon] == GAS:
                amounts[balloon] = pumped_amount(amounts[balloon], ramps[balloon], time_in_frame, t.step_seconds)
        for tube in range(t.tubes.balloons.shape[0]):
            first = t.tubes.balloons[tube][0]
            second = t.tubes.balloons[tube][1]
            flow = tube_flow(
                t.tubes.conductance[row_of_world(world, t.tubes.conductance.shape[0]), tube],
                wp.vec2(pressures[first], pressures[second]),
                wp.vec2(float(amounts[first]), float(amounts[second])),
                t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), first, gamma],
                t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), air_pressure],
                t.step_seconds,
            )
            amounts[first] = wp.max(amounts[first] - wp.float64(flow), wp.float64(0.0))
            amounts[second] = wp.max(amounts[second] + wp.float64(flow), wp.float64(0.0))

    return flow_of_gas


@cache
def gas_mass_function(columns: Columns) -> Any:
    """The function that weighs a balloon's gas."""
    column = columns.places["molar_mass"]

    @wp.func
    def gas_mass(t: Tables, amounts: wp.array[wp.float64], world: wp.int32, balloon: wp.int32):
        """[kg]; it moves along with the balloon."""
        row = row_of_world(world, t.balloon_numbers.shape[0])
        return float(amounts[balloon]) * t.balloon_numbers[row, balloon, column]

    return gas_mass


@wp.func
def time_of(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """Since the simulation began [s]."""
    return float(frame[0]) * t.frame_seconds + time_in_frame


@wp.func
def volume_origin(t: Tables, balloon: wp.int32):
    """The particle of a balloon about which its volume is taken: one of a face."""
    return t.faces.particles[t.faces.offsets[t.faces.balloon_offsets[balloon]]]


@wp.func
def ramp_at(state: WorldState, world: wp.int32, balloon: wp.int32, time_in_frame: float):
    """What is keyframed, such as k_normal, at a time of the frame."""
    ramp = state.inflation_ramp[world, balloon]
    return ramp[0] + ramp[1] * time_in_frame
