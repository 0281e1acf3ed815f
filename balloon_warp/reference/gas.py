"""Sealed gas: its pressure in a step, and gas that is pumped in, leaves by openings, and flows through tubes.

A gas has an amount n [mol], a free volume V0 [m^3] and a gauge pressure [Pa], see docs/GAS.md; `p` has its parameters.
"""

import numpy as np

R, ATMOSPHERE, DRY_AIR, EMPTY = 8.314462618, 101325.0, 0.0289652, 0.02
"""Gas constant [J/(mol K)]; one atmosphere [Pa]; molar mass of dry air [kg/mol]; part of a mesh's volume that stays"""


def air(height, p):
    """Return the air's pressure, temperature and density, at rest under gravity where it grows colder with height."""
    density = p.air_density if p.air_density >= 0.0 else DRY_AIR * p.air_pressure / (R * p.air_temperature)
    if p.air_lapse == -1.0:  # uniform
        return p.air_pressure, p.air_temperature, density + 0.0 * height
    part = np.minimum(p.air_lapse * height / p.air_temperature, 0.9)
    more = np.where(np.abs(part) > 1e-6, -np.log1p(-part) / np.where(part == 0.0, 1.0, part), 1.0 + 0.5 * part)
    ratio = np.exp(-density * p.gravity * height * more / p.air_pressure)
    return p.air_pressure * ratio, p.air_temperature * (1.0 - part), density * ratio / (1.0 - part)


def there(free_volume, temperature, p):
    """Return a free volume at the air's temperature there, which it depends on where heat passes, gamma = 1."""
    return free_volume * (temperature / p.air_temperature if p.gamma == 1.0 else 1.0)


def throttled(free_volume, before, after, gamma):
    """Return the free volume of a mole behind a valve, which keeps its enthalpy; pressures are absolute."""
    return free_volume * (before / after) ** (1.0 - 1.0 / gamma)


def implicit_pressure(gas, p, h, bound, volume, response, rate, height, response_height):
    """Set the pressure P = p(V) - w s h r over a step, its load at height 0 and rise [Pa/m], and slope [Pa/m^3].

    s = -dp/dV, r = rate + response P the growth of the volume, by forces along all area vectors, and w its weight:
    backward Euler where breathing is damped, or the trapezoidal rule. Near empty the end's pressure is exact.
    """
    outside, temperature, density = air(height, p)
    free = there(gas.free_volume, temperature, p)
    explicit = ATMOSPHERE * (free / volume) ** p.gamma - outside
    gas.rise = (density - gas.amount * p.molar_mass / volume) * p.gravity
    rate = rate + gas.rise * (response_height - height * response)
    pull = (0.25 + 0.75 * p.breathing_damping) * p.gamma * (outside + explicit) / volume * h
    gas.pressure = (explicit - pull * rate) / (1.0 + pull * response)
    gas.slope = p.gamma * (outside + explicit) / free / (1.0 + pull * response)
    without, added = volume + h * rate, h * response
    if without + added * gas.pressure < 0.5 * volume:
        held = added * outside * free * (ATMOSPHERE / outside) ** (1.0 / p.gamma)
        half = 0.5 * (without - added * outside)
        root = np.hypot(half, np.sqrt(held))
        end = half + root if half > 0.0 else held / (root - half)
        gas.pressure, gas.slope = (end - without) / added, end * outside / (end**2 + held)
    gas.pressure = min(gas.pressure, bound * p.mass / h**2)  # where the turning of the skin is stable
    gas.load = gas.pressure - gas.rise * height


def given_pressure(gas, p, h, given, enclosed, fall, volume, response, rate, height, response_height):
    """Set pressure and load of a balloon of a given one, raised where its volume would fall below a least one.

    On a flat skin in a liquid it rises with depth as the liquid does, `fall` [Pa/m], and nothing turns inside out.
    """
    gas.pressure, gas.rise, middle = given, 0.0, height
    if enclosed >= 0.0 and response > 0.0:
        least, flat = EMPTY * enclosed, 0.1 * enclosed
        gas.pressure += max(least - volume - h * (rate + response * given), 0.0) / (h * response)
        middle = response_height / response
        if fall and middle < p.water_level:
            gas.rise = -fall * np.clip((flat - volume) / max(flat - least, 1e-30), 0.0, 1.0)
    gas.load = gas.pressure - gas.rise * middle
    gas.pressure = gas.load + gas.rise * height


def raise_pressure(gas, free_volume):
    """Raise the pressure of a step by more free volume in it."""
    gas.pressure, gas.load = gas.pressure + gas.slope * free_volume, gas.load + gas.slope * free_volume


def take(gas, moles, p, temperature):
    """Let an amount in at the air's temperature, through a valve, or if negative out with its part of free volume."""
    part, gas.amount = moles / max(gas.amount, 1e-20), gas.amount + moles
    if p.gamma == 1.0:
        gas.free_volume = gas.amount * R * p.air_temperature / ATMOSPHERE
    elif moles > 0.0:
        mole = R * temperature / ATMOSPHERE
        gas.free_volume += moles * throttled(mole, ATMOSPHERE, gas.outside + gas.pressure, p.gamma)
    else:
        gas.free_volume *= 1.0 + part


def filled(gas, p, h, time, pumped, curve):
    """Return the amount that is filled in a step [mol]: by keyframes, a pump's curve, and breaths, up to an end."""
    outside, temperature = gas.outside, gas.temperature
    mole, full = R * temperature / outside, R * temperature
    volume = there(gas.free_volume, temperature, p) * (ATMOSPHERE / (outside + gas.pressure)) ** (1.0 / p.gamma)
    blown = p.fill_moles + (1e-3 * p.fill_litres + 3.5e-3 * p.fill_breaths) / mole
    moles = pumped + blown * np.clip(p.fill_time - time, 0.0, h) / p.fill_time
    if curve:
        pressures, flows = zip(*curve, strict=True)
        moles += h * np.interp(gas.pressure, pressures, flows, right=0.0)
    elif pumped == 0.0 and (p.fill_to_pressure > 0.0 or p.fill_to_diameter > 0.0):
        moles += 3.5e-3 / mole * h / p.fill_time
    if moles > 0.0 and p.fill_to_pressure > 0.0:
        moles = np.clip((p.fill_to_pressure - gas.pressure) * volume / (p.gamma * full), 0.0, moles)
    if moles > 0.0 and p.fill_to_diameter > 0.0:
        moles = np.clip((np.pi / 6.0 * p.fill_to_diameter**3 - volume) * (outside + gas.pressure) / full, 0.0, moles)
    return moles


def nozzle(pressure, behind, gamma):
    """Return the flow through an opening over that of Bernoulli's law, and its thrust over 2 C A p.

    The gas expands without heat down to the pressure outside, or to that at which it is as fast as sound (de
    Saint-Venant and Wantzel 1839).
    """
    k = np.maximum(gamma, 1.4)
    drop = np.maximum(np.clip(pressure / behind, 0.0, 1.0), 1e-12)
    x = np.minimum(drop, 1.0 - (2.0 / (k + 1.0)) ** (k / (k - 1.0)))
    work, density = -np.expm1((1.0 - 1.0 / k) * np.log1p(-x)) * k / (k - 1.0), (1.0 - x) ** (1.0 / k)
    return density * np.sqrt(work / drop), density * work / drop + 0.5 * (1.0 - x / drop)


def vent(gas, p, h, opening):
    """Find the flow out of openings at the step's end, instead of the one believed before."""
    taken = there(gas.free_volume / max(gas.amount, 1e-20), gas.temperature, p)
    inside = gas.outside + gas.pressure
    brought = throttled(R * gas.temperature / ATMOSPHERE, ATMOSPHERE, inside, p.gamma)
    raise_pressure(gas, h * gas.vent * (taken if gas.vent > 0.0 else brought))
    if gas.pressure > 0.0:
        mole = taken * (ATMOSPHERE / inside) ** (1.0 / p.gamma)
        density, softness, most = p.molar_mass / mole, gas.slope * taken, max(gas.amount - gas.least, 0.0) / h
    else:
        mole = R * gas.temperature / gas.outside
        density, softness, most = gas.density, gas.slope * brought, np.inf
    ahead = (gas.outside + gas.pressure, p.gamma) if gas.pressure > 0.0 else (gas.outside, 1.4)
    squared = 2.0 * (opening * nozzle(abs(gas.pressure), *ahead)[0]) ** 2 / (density * mole**2)
    driven, held = squared * abs(gas.pressure), squared * softness * h
    flow = 2.0 * driven / (held + np.sqrt(held**2 + 4.0 * driven) + 1e-300)
    gas.vent = min(flow, most) if gas.pressure > 0.0 else -flow
    raise_pressure(gas, -h * gas.vent * (taken if gas.vent > 0.0 else brought))


def flow(gases, tubes, openings, ps, h):
    """Let gas flow through tubes and openings, by the pressures at the step's end, which all change together."""
    flows = np.zeros(len(tubes))
    for gas in gases:
        gas.vent = 0.0
    for _ in range(8 if len(tubes) > 1 or (len(tubes) and any(openings)) else 1):
        for k, (first, second, conductance) in enumerate(tubes):
            ends, p = (gases[first], gases[second]), (ps[first], ps[second])
            source = ends[0] if ends[0].pressure > ends[1].pressure else ends[1]
            moles = [there(source.free_volume / source.amount, g.temperature, q) for g, q in zip(ends, p, strict=True)]
            most = [max(g.amount - g.least, 0.0) / h for g in ends]
            softness = moles[0] * ends[0].slope + moles[1] * ends[1].slope
            more = conductance * (ends[0].pressure - ends[1].pressure) - flows[k]
            more = np.clip(flows[k] + more / (1.0 + conductance * h * softness), -most[1], most[0]) - flows[k]
            flows[k] += more
            for gas, mole, sign in zip(ends, moles, (-1.0, 1.0), strict=True):
                raise_pressure(gas, sign * h * more * mole)
        for gas, p, opening in zip(gases, ps, openings, strict=True):
            if opening > 0.0:
                vent(gas, p, h, opening)
    for k, (first, second, _) in enumerate(tubes):
        source, sink = (gases[first], gases[second]) if flows[k] > 0.0 else (gases[second], gases[first])
        moles = min(h * abs(flows[k]), source.amount)
        taken = source.free_volume / max(source.amount, 1e-20)
        inside = source.outside + source.pressure, sink.outside + sink.pressure
        source.amount, source.free_volume = source.amount - moles, max(source.free_volume - moles * taken, 0.0)
        sink.amount += moles
        sink.free_volume += moles * throttled(taken, *inside, ps[first].gamma)
    for gas, p in zip(gases, ps, strict=True):
        if gas.vent:
            take(gas, -h * gas.vent, p, gas.temperature)
