"""Gas of the balloons of a world: pumps, leaks, tubes, jets, mass and pressure."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import call_of, function_from, function_here, numbers_reader
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import STATE_OF_AIR, density_of_air
from balloon_warp.kernels.laws.flow import SHARP_EDGE, blown_in, breath_in, neck_opening, thrust, up_to, vent_flow
from balloon_warp.kernels.laws.gas import (
    STANDARD_PRESSURE,
    THINNEST,
    Swelling,
    amount_when_flat,
    borne_load,
    flow_and_fall,
    free_volume_there,
    gas_load,
    gas_through_tube,
    given_load,
    molar_free_volume,
    pumped_gas,
    volume_at,
)
from balloon_warp.kernels.laws.outer import GAS
from balloon_warp.kernels.loops.areas import hole_loop
from balloon_warp.kernels.tables import NeckTable, Tables, WorldState, row_of_world


@cache
def air_function(features: Features) -> Any:
    """Return the function for the air at a balloon: pressure [Pa], temperature [K] and density [kg/m^3]."""
    of_world = [features.columns.places[row.name] - features.columns.balloon_width for row in STATE_OF_AIR]
    pressure_column, temperature_column, density_column = of_world

    @wp.func
    def air_at(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        if wp.static(features.gas_meets_air):
            return state.airs[world, balloon]
        else:
            row = row_of_world(world, t.world_numbers.shape[0])
            pressure = t.world_numbers[row, pressure_column]
            temperature = t.world_numbers[row, temperature_column]
            return wp.vec3(
                pressure, temperature, density_of_air(pressure, temperature, t.world_numbers[row, density_column])
            )

    return air_at


@cache
def warmth_function(features: Features) -> Any:
    """Return the function that corrects free volumes of gas by the air's temperature at the balloon.

    See `laws.gas.free_volume_there`.
    """
    temperature_column = features.columns.places["air_temperature"] - features.columns.balloon_width
    gamma_column = features.columns.places["gamma"]

    @wp.func
    def as_warm_there(t: Tables, world: wp.int32, balloon: wp.int32, free_volume: float, air: wp.vec3):
        if wp.static(features.gas_meets_air):
            gamma = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, gamma_column]
            level = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), temperature_column]
            return free_volume_there(free_volume, gamma, air[1] / level)
        else:
            return free_volume

    return as_warm_there


@wp.func
def max_outflow(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, air: wp.vec3):
    """Return the largest flow of gas out of a balloon in a substep, up to which it is not flat [mol/s]."""
    spare = float(state.gas_amounts[world, balloon]) - amount_when_flat(t.faces.enclosed[balloon][0], air)
    return wp.max(spare, 0.0) / t.step_seconds


@cache
def own_gas_test(features: Features) -> Any:
    """Return the test whether a balloon has gas of its own: one that has burst does, until it is open."""

    @wp.func
    def holds_gas(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        holds = t.inflation_kind[balloon] == GAS
        if wp.static(features.bursts):
            burst = state.bursts[world, balloon]
            holds = burst[1] >= 0.0 and (holds or burst[0] >= 0.0)
        return holds

    return holds_gas


@cache
def load_function(features: Features) -> Any:
    """Make the function that finds a balloon's pressure above the air's from its swelling, its gas and the step.

    It gives the pressure at the center of mass [Pa], at height 0, its rise with height [Pa/m], and how more gas would
    raise both.
    """
    fixed = {} if features.breathes_on else {"breathing_damping": "1.0"}
    if not features.air_varies:
        fixed["air_lapse"] = "-1.0"

    def here(law: Any, **given: str) -> Any:
        """Return a law as a function of its given arguments and the row of numbers."""
        told = fixed | {name: name for name in given}
        call = call_of(law, "law", list(told), features.columns, lambda name: told[name])
        arguments = ", ".join(f"{name}: {kind}" for name, kind in given.items())
        source = f"def {law.key}_here({arguments}, n: Any):\n    return {call}\n"
        return function_from(f"{law.key}_here", source, {"law": law})

    load_of_gas = here(gas_load, swelling="Any", gas="wp.vec2", step_seconds="float")
    borne = here(borne_load, load="wp.vec4", bound="float", step_seconds="float")
    load_of_given = here(given_load, swelling="Any", given="float", mesh_volume="float", step_seconds="float")

    @wp.func
    def load_of_balloon(
        kind: wp.int32,
        given: float,
        swelling: Swelling,
        gas: wp.vec2,
        step_seconds: float,
        enclosed: wp.vec2,
        n: Any,
    ):
        """Return the load of a balloon; `given` is the gauge pressure of a balloon without gas [Pa].

        Args:
            enclosed: see `kernels.tables.FaceTable`.
        """
        if kind == GAS:
            return borne(load_of_gas(swelling, gas, step_seconds, n), enclosed[1], step_seconds, n)
        if wp.static(features.crushes):
            return load_of_given(swelling, given, enclosed[0], step_seconds, n)
        else:
            return wp.vec4(given, given, 0.0, 0.0)

    return load_of_balloon


@cache
def jet_loop(features: Features, at: Any) -> Any:
    """Return the function for a particle's share of its balloon's thrust."""
    opening_of_neck = function_here(neck_opening, ["time"], features.columns)
    thrust_of = function_here(thrust, ["opening", "pressure"], features.columns)

    @wp.func
    def jet(
        necks: NeckTable,
        points: Any,
        weight: float,
        balloon: wp.int32,
        load: wp.vec2,
        height: float,
        time: float,
        n: Any,
    ):
        """Force [N], inwards across the neck: its edges in turn enclose an area vector of the direction of the jet.

        Args:
            weight: the particle's part.
            load: pressure at height 0 [Pa], and its rise with height [Pa/m].
            height: of the particle [m].
        """
        force = wp.vec3()
        if weight > 0.0:
            out = wp.vec3()
            first = necks.offsets[balloon]
            origin = at(points, necks.edges[first][0])
            for edge in range(first, necks.offsets[balloon + 1]):
                ends = necks.edges[edge]
                out += wp.cross(at(points, ends[0]) - origin, at(points, ends[1]) - origin)
            pressure = load[0] + load[1] * height
            force = (-weight * thrust_of(opening_of_neck(time, n), pressure, n)) * wp.normalize(out)
        return force

    return jet


@cache
def hole_jet_loop(features: Features, at: Any) -> Any:
    """Return the function for a particle's share of the thrust of holes where its balloon is torn."""
    area_vector_of_holes = hole_loop(at)
    thrust_of = function_here(thrust, ["opening", "pressure"], features.columns)

    @wp.func
    def jet_of_holes(t: Tables, points: Any, params: Any, load: wp.vec2, point: wp.vec3):
        """Force [N]; `load` is the pressure at height 0 [Pa], and its rise with height [Pa/m]."""
        hole = area_vector_of_holes(t, points, params.world, params.number, point)
        return -thrust_of(SHARP_EDGE, load[0] + load[1] * wp.dot(point, t.up), params.n) * hole

    return jet_of_holes


@wp.func
def gas_in(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Return the amount [mol] and free volume [m^3] of the gas in a balloon."""
    return wp.vec2d(state.gas_amounts[world, balloon], state.free_volumes[world, balloon])


@wp.func
def put_gas(state: WorldState, world: wp.int32, balloon: wp.int32, gas: wp.vec2d):
    """Set amount and free volume of the gas in a balloon."""
    state.gas_amounts[world, balloon] = gas[0]
    state.free_volumes[world, balloon] = gas[1]


@cache
def filled_function(features: Features) -> Any:
    """Return the function for the gas blown into a balloon in a substep, from its state, the air and the time."""
    columns = features.columns
    gamma_column = columns.places["gamma"]
    air = ["air_pressure", "air_temperature"]
    blown_in_here = function_here(blown_in, ["time", "step_seconds", *air], columns)
    breath_in_here = function_here(breath_in, ["step_seconds", *air], columns)
    up_to_here = function_here(up_to, ["moles", "pressure", "volume", *air], columns)
    ends = [columns.places[name] for name in ("fill_to_pressure", "fill_to_diameter")]
    to_pressure_column, to_diameter_column = ends

    @wp.func
    def filled(
        pumped: float, curved: bool, by_curve: float, pressure: float, free_volume: float, time: float,
        step_seconds: float, air_pressure: float, air_temperature: float, n: Any,
    ):  # fmt: skip
        """Return the amount of gas that is filled in [mol].

        Args:
            pumped: by keyframes [mol].
            curved: whether there is a pump with a curve, which gives `by_curve` [mol].
            free_volume: of the gas, as warm as the air there [m^3].
        """
        here = wp.max(air_pressure + pressure, THINNEST * STANDARD_PRESSURE)
        volume = volume_at(free_volume, here, n[gamma_column])
        moles = pumped + blown_in_here(time, step_seconds, air_pressure, air_temperature, n)
        if curved:
            moles += by_curve
        ends = n[to_pressure_column] > 0.0 or n[to_diameter_column] > 0.0
        if ends and not curved and pumped == 0.0:
            moles += breath_in_here(step_seconds, air_pressure, air_temperature, n)
        if ends and moles > 0.0:
            moles = up_to_here(moles, pressure, volume, air_pressure, air_temperature, n)
        return moles

    return filled


@wp.func
def curve_flow(t: Tables, balloon: wp.int32, pressure: float):
    """Return the flow of a pump against a pressure [mol/s]: linear between the curve's points, zero beyond them."""
    flow = t.pumps.flows[balloon, 0]
    for point in range(t.pumps.flows.shape[1] - 1):
        begin = t.pumps.pressures[balloon, point]
        end = t.pumps.pressures[balloon, point + 1]
        if pressure > begin and end > begin:
            part = wp.min((pressure - begin) / (end - begin), 1.0)
            flow = wp.lerp(t.pumps.flows[balloon, point], t.pumps.flows[balloon, point + 1], part)
    return wp.where(pressure > t.pumps.pressures[balloon, t.pumps.flows.shape[1] - 1], 0.0, flow)


@cache
def fill_function(features: Features) -> Any:
    """Return the function for the gas blown into a balloon in a substep, besides the pumped gas."""
    air_at, as_warm_there = air_function(features), warmth_function(features)
    filled, read_numbers = filled_function(features), numbers_reader(features.columns)

    @wp.func
    def fill(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, pumped: float, time: float):
        """Return the amount of gas that is filled in [mol]."""
        n = read_numbers(t, world, balloon)
        air = air_at(t, state, world, balloon)
        pressure = state.pressures[world, balloon]
        free_volume = as_warm_there(t, world, balloon, float(state.free_volumes[world, balloon]), air)
        curved = t.pumps.has[balloon] > 0
        by_curve = float(0.0)
        if curved:
            by_curve = t.step_seconds * curve_flow(t, balloon, pressure)
        return filled(pumped, curved, by_curve, pressure, free_volume, time, t.step_seconds, air[0], air[1], n)

    return fill


@cache
def pump_function(features: Features) -> Any:
    """Return the function that pumps gas, or lets it out."""
    columns = features.columns
    gamma_column = columns.places["gamma"]
    temperature_column = columns.places["air_temperature"] - columns.balloon_width
    air_at = air_function(features)
    fill = fill_function(features) if features.fills else None
    holds_gas = own_gas_test(features)

    @wp.func
    def pump_gas(t: Tables, state: WorldState, world: wp.int32, time_in_frame: float, time: float):
        """Add the gas that is pumped in during a substep, as it begins; `inflation_ramp` has it in mol/s."""
        of_balloons = row_of_world(world, t.balloon_numbers.shape[0])
        of_world = row_of_world(world, t.world_numbers.shape[0])
        for balloon in range(t.inflation_kind.shape[0]):
            if t.inflation_kind[balloon] == GAS and holds_gas(t, state, world, balloon):
                ramp = state.inflation_ramp[world, balloon]
                moles = t.step_seconds * (ramp[0] + ramp[1] * (time_in_frame + 0.5 * t.step_seconds))
                if wp.static(fill is not None):
                    moles = fill(t, state, world, balloon, moles, time)
                air = air_at(t, state, world, balloon)
                least = amount_when_flat(t.faces.enclosed[balloon][0], air)
                gas = pumped_gas(
                    gas_in(state, world, balloon), moles, least, air[0] + state.pressures[world, balloon],
                    t.balloon_numbers[of_balloons, balloon, gamma_column],
                    t.world_numbers[of_world, temperature_column], air[1],
                )  # fmt: skip
                put_gas(state, world, balloon, gas)

    return pump_gas


@wp.func
def raise_pressure(state: WorldState, world: wp.int32, balloon: wp.int32, free_volume: float):
    """Raise the pressure by the effect of additional free volume within the substep [m^3]."""
    by = state.pressure_slopes[world, balloon] * free_volume
    load = state.inflation_loads[world, balloon]
    state.pressures[world, balloon] = state.pressures[world, balloon] + by
    state.inflation_loads[world, balloon] = wp.vec2(load[0] + by, load[1])


@cache
def vent_function(features: Features) -> tuple[Any, Any]:
    """Return functions that find and take the gas that flows out of a balloon, or the air that flows in.

    The first needs the pressures without the flow.
    """
    columns = features.columns
    gamma_column, leak_column, temperature_column = (
        columns.places[name] for name in ("gamma", "leak", "air_temperature")
    )
    air_at, as_warm_there = air_function(features), warmth_function(features)
    read_numbers, opening_of_neck = numbers_reader(columns), function_here(neck_opening, ["time"], columns)
    functions_of_laws = ["flow", "pressure", "taken", "slope", "step_seconds", "opening", "most"]
    flow_of_vent = function_here(vent_flow, [*functions_of_laws, *(row.name for row in STATE_OF_AIR)], columns)

    @wp.func
    def find_vent(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, time: float):
        """Find the flow out of a balloon by the pressure at the end of the substep, which the flow changes."""
        n = read_numbers(t, world, balloon)
        opening = opening_of_neck(time, n) + n[leak_column]
        if wp.static(features.bursts):
            opening += SHARP_EDGE * wp.max(state.bursts[world, balloon][1], 0.0)
        air = air_at(t, state, world, balloon)
        a_mole = as_warm_there(t, world, balloon, molar_free_volume(gas_in(state, world, balloon)), air)
        most = max_outflow(t, state, world, balloon, air)
        flow_and_more = flow_of_vent(
            state.vent_flows[world, balloon], state.pressures[world, balloon], a_mole,
            state.pressure_slopes[world, balloon], t.step_seconds, opening, most,
            air[0], air[1], air[2], n,
        )  # fmt: skip
        state.vent_flows[world, balloon] = flow_and_more[0]
        raise_pressure(state, world, balloon, -t.step_seconds * flow_and_more[1])

    @wp.func
    def take_vented(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, time: float):
        """Take vented gas from a balloon, and store the thrust of its jet."""
        n = read_numbers(t, world, balloon)
        air = air_at(t, state, world, balloon)
        state.thrusts[world, balloon] = thrust(
            opening_of_neck(time, n), state.pressures[world, balloon], n[gamma_column], air[0]
        )
        gas = pumped_gas(
            gas_in(state, world, balloon), -t.step_seconds * state.vent_flows[world, balloon], 0.0,
            air[0] + state.pressures[world, balloon], n[gamma_column], n[temperature_column], air[1],
        )  # fmt: skip
        put_gas(state, world, balloon, gas)

    return find_vent, take_vented


@cache
def gas_mass_function(features: Features) -> Any:
    """Return the function for the mass of a balloon's gas, with the added mass of the air around it."""
    column = features.columns.places["molar_mass"]

    @wp.func
    def gas_mass(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        """Return the mass of the gas, which moves along with the balloon [kg]."""
        amount = float(state.gas_amounts[world, balloon])
        if wp.static(
            features.bursts
        ):  # air in a balloon that had a pressure until it burst is not weighed before either
            amount = wp.where(t.inflation_kind[balloon] == GAS, amount, 0.0)
        gas = amount * t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, column]
        if wp.static(features.takes_air_along):
            gas += state.air_along[world, balloon]
        return gas

    return gas_mass


SWEEPS = 8
"""Number of sweeps over tubes whose flows depend on each other"""


@cache
def tube_functions(features: Features) -> tuple[Any, Any]:
    """Return functions that find the flow of a tube, and that let its gas flow."""
    gamma_column = features.columns.places["gamma"]
    air_at, as_warm_there = air_function(features), warmth_function(features)

    @wp.func
    def find_flow(t: Tables, state: WorldState, world: wp.int32, tube: wp.int32):
        """Find the flow of a tube by the pressures at its ends after the step."""
        first = t.tubes.balloons[tube][0]
        second = t.tubes.balloons[tube][1]
        pressures = wp.vec2(state.pressures[world, first], state.pressures[world, second])
        source = wp.where(pressures[0] - pressures[1] > 0.0, first, second)
        a_mole = molar_free_volume(gas_in(state, world, source))
        moles = wp.vec2(
            as_warm_there(t, world, first, a_mole, air_at(t, state, world, first)),
            as_warm_there(t, world, second, a_mole, air_at(t, state, world, second)),
        )
        most = wp.vec2(
            max_outflow(t, state, world, first, air_at(t, state, world, first)),
            max_outflow(t, state, world, second, air_at(t, state, world, second)),
        )
        slopes = wp.vec2(state.pressure_slopes[world, first], state.pressure_slopes[world, second])
        conductance = t.tubes.conductance[row_of_world(world, t.tubes.conductance.shape[0]), tube]
        flow = state.tube_flows[world, tube]
        found = flow_and_fall(flow, pressures, slopes, moles, most, conductance, t.step_seconds)
        state.tube_flows[world, tube] = found[0]
        raise_pressure(state, world, first, found[1])
        raise_pressure(state, world, second, found[2])

    @wp.func
    def let_gas_flow(t: Tables, state: WorldState, world: wp.int32, tube: wp.int32):
        """Let the gas of a tube's flow through."""
        moles = t.step_seconds * state.tube_flows[world, tube]
        source = t.tubes.balloons[tube][wp.where(moles > 0.0, 0, 1)]
        sink = t.tubes.balloons[tube][wp.where(moles > 0.0, 1, 0)]
        air = wp.vec2(air_at(t, state, world, source)[0], air_at(t, state, world, sink)[0])
        pressures = air + wp.vec2(state.pressures[world, source], state.pressures[world, sink])
        left, gained = gas_through_tube(
            gas_in(state, world, source), gas_in(state, world, sink), wp.abs(moles), pressures,
            t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), source, gamma_column],
        )  # fmt: skip
        put_gas(state, world, source, left)
        put_gas(state, world, sink, gained)

    return find_flow, let_gas_flow


@wp.func
def sweeps_of_tubes(tubes: wp.int32, vents: bool):
    """Return the number of sweeps over tubes, and over openings beside them."""
    return wp.where(tubes > 1 or (vents and tubes > 0), SWEEPS, 1)


@cache
def flows_function(features: Features) -> Any:
    """Return the function that exchanges gas through tubes and openings, from the loads without flow."""
    find_vent, take_vented = vent_function(features) if features.vents else (None, None)
    find_flow, let_gas_flow = tube_functions(features)
    holds_gas = own_gas_test(features)

    @wp.func
    def find_flows(t: Tables, state: WorldState, world: wp.int32, time: float):
        """Find all flows and pressures, which depend on each other, in several sweeps."""
        count = t.tubes.balloons.shape[0]
        for tube in range(count):
            state.tube_flows[world, tube] = 0.0
        sweeps = sweeps_of_tubes(count, wp.static(features.vents))
        if wp.static(features.vents):
            for balloon in range(t.inflation_kind.shape[0]):
                state.vent_flows[world, balloon] = 0.0
        for _sweep in range(sweeps):
            for tube in range(count):
                find_flow(t, state, world, tube)
            if wp.static(features.vents):
                for balloon in range(t.inflation_kind.shape[0]):
                    if holds_gas(t, state, world, balloon):
                        find_vent(t, state, world, balloon, time)

    @wp.func
    def let_gases_flow(t: Tables, state: WorldState, world: wp.int32, time: float):
        """Apply a substep's flows to pressures, loads and gases."""
        find_flows(t, state, world, time)
        for tube in range(t.tubes.balloons.shape[0]):
            let_gas_flow(t, state, world, tube)
        if wp.static(features.vents):
            for balloon in range(t.inflation_kind.shape[0]):
                if holds_gas(t, state, world, balloon):
                    take_vented(t, state, world, balloon, time)

    return let_gases_flow
