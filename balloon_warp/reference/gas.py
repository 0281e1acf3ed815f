"""Sealed gas of a balloon b: its pressure in a step, and gas that is pumped in, leaves by openings, and flows in tubes.

A gas has an amount n [mol], a free volume V0 [m^3] at one atmosphere and a gauge pressure [Pa]; see docs/GAS.md.
"""

import numpy as np

from balloon_warp.reference.laws import ATMOSPHERE, R, air, nozzle

EMPTY = 0.02
"""Part of a mesh's volume that stays"""


def there(free_volume, b, temperature):
    """Return a free volume at the air's temperature there, which it depends on where heat passes, gamma = 1."""
    return free_volume * (temperature / b.p.air_temperature if b.p.gamma == 1.0 else 1.0)


def throttled(free_volume, before, after, gamma):
    """Return the free volume of a mole behind a valve, which keeps its enthalpy; pressures are absolute."""
    return free_volume * (before / after) ** (1.0 - 1.0 / gamma)


def begin_frame(b, height):
    """Find the air around a balloon, the air that its gas moves along, and the least amount that stays."""
    b.outside, b.temperature, b.density = air(height, b.p)
    if b.kind == "gas":
        inside = (ATMOSPHERE / (b.outside + b.pressure)) ** (1.0 / b.p.gamma)
        b.along = b.p.added_mass * b.density * there(b.free_volume, b, b.temperature) * inside
    b.least = EMPTY * b.volume * b.outside / (R * b.temperature)


def implicit_pressure(b, h, damping, volume, response, rate, height, response_height):
    """Set the pressure P = p(V) - w s h r over a step, its load at height 0 and rise [Pa/m], and slope [Pa/m^3].

    s = -dp/dV, r = rate + response P the growth of the volume, by forces along all area vectors, and w its weight:
    backward Euler where breathing is damped, or the trapezoidal rule. Near empty the end's pressure is exact.
    """
    outside, temperature, density = air(height, b.p)
    free = there(b.free_volume, b, temperature)
    explicit = ATMOSPHERE * (free / volume) ** b.p.gamma - outside
    b.rise = (density - b.amount * b.p.molar_mass / volume) * b.p.gravity
    rate = rate + b.rise * (response_height - height * response)
    pull = (0.25 + 0.75 * damping) * b.p.gamma * (outside + explicit) / volume * h
    b.pressure = (explicit - pull * rate) / (1.0 + pull * response)
    b.slope = b.p.gamma * (outside + explicit) / free / (1.0 + pull * response)
    without, added = volume + h * rate, h * response
    if without + added * b.pressure < 0.5 * volume:
        held = added * outside * free * (ATMOSPHERE / outside) ** (1.0 / b.p.gamma)
        half = 0.5 * (without - added * outside)
        root = np.hypot(half, np.sqrt(held))
        end = half + root if half > 0.0 else held / (root - half)
        b.pressure, b.slope = (end - without) / added, end * outside / (end**2 + held)
    b.pressure = min(b.pressure, b.bound * b.p.mass / h**2)  # where the turning of the skin is stable
    b.load = b.pressure - b.rise * height


def given_pressure(b, h, given, volume, response, rate, height, response_height):
    """Set pressure and load of a balloon of a given one, raised where its volume would fall below a least one.

    On a flat skin in a liquid it rises with depth as the liquid does, and nothing turns inside out.
    """
    b.pressure, b.rise, middle = given, 0.0, height
    if b.enclosed >= 0.0 and response > 0.0:
        least, flat = EMPTY * b.enclosed, 0.1 * b.enclosed
        b.pressure += max(least - volume - h * (rate + response * given), 0.0) / (h * response)
        middle = response_height / response
        if b.world.water and middle < b.p.water_level:
            flatness = np.clip((flat - volume) / max(flat - least, 1e-30), 0.0, 1.0)
            b.rise = -b.p.water_density * b.p.gravity * flatness
    b.load = b.pressure - b.rise * middle
    b.pressure = b.load + b.rise * height


def raise_pressure(b, free_volume):
    """Raise the pressure of a step by more free volume in it."""
    b.pressure, b.load = b.pressure + b.slope * free_volume, b.load + b.slope * free_volume


def take(b, moles):
    """Let an amount in at the air's temperature, through a valve, or if negative out with its part of free volume."""
    part, b.amount = moles / max(b.amount, 1e-20), b.amount + moles
    if b.p.gamma == 1.0:
        b.free_volume = b.amount * R * b.p.air_temperature / ATMOSPHERE
    elif moles > 0.0:
        mole = R * b.temperature / ATMOSPHERE
        b.free_volume += moles * throttled(mole, ATMOSPHERE, b.outside + b.pressure, b.p.gamma)
    else:
        b.free_volume *= 1.0 + part


def fill(b, h, pumped):
    """Fill a balloon in a step: by keyframes, a pump's curve, and breaths, up to an end; or empty it until flat."""
    p, inside, full = b.p, b.outside + b.pressure, R * b.temperature
    volume = there(b.free_volume, b, b.temperature) * (ATMOSPHERE / inside) ** (1.0 / p.gamma)
    blown = p.fill_moles + (1e-3 * p.fill_litres + 3.5e-3 * p.fill_breaths) / (full / b.outside)
    moles = pumped + blown * np.clip(p.fill_time - b.world.time, 0.0, h) / p.fill_time
    if b.curve:
        pressures, flows = zip(*b.curve, strict=True)
        moles += h * np.interp(b.pressure, pressures, flows, right=0.0)
    elif pumped == 0.0 and (p.fill_to_pressure > 0.0 or p.fill_to_diameter > 0.0):
        moles += 3.5e-3 / (full / b.outside) * h / p.fill_time
    if moles > 0.0 and p.fill_to_pressure > 0.0:
        moles = np.clip((p.fill_to_pressure - b.pressure) * volume / (p.gamma * full), 0.0, moles)
    if moles > 0.0 and p.fill_to_diameter > 0.0:
        moles = np.clip((np.pi / 6.0 * p.fill_to_diameter**3 - volume) * inside / full, 0.0, moles)
    if moles:
        take(b, max(moles, min(b.least - b.amount, 0.0)))


def vent(b, h):
    """Find the flow out of openings at the step's end, instead of the one believed before."""
    taken = there(b.free_volume / max(b.amount, 1e-20), b, b.temperature)
    inside = b.outside + b.pressure
    brought = throttled(R * b.temperature / ATMOSPHERE, ATMOSPHERE, inside, b.p.gamma)
    raise_pressure(b, h * b.vent * (taken if b.vent > 0.0 else brought))
    mole, density, softness = R * b.temperature / b.outside, b.density, b.slope * brought
    ahead, most = (b.outside, 1.4), np.inf
    if b.pressure > 0.0:
        mole = taken * (ATMOSPHERE / inside) ** (1.0 / b.p.gamma)
        density, softness, most = b.p.molar_mass / mole, b.slope * taken, max(b.amount - b.least, 0.0) / h
        ahead = b.outside + b.pressure, b.p.gamma
    squared = 2.0 * ((b.opening + b.p.leak) * nozzle(abs(b.pressure), *ahead)[0]) ** 2 / (density * mole**2)
    driven, held = squared * abs(b.pressure), squared * softness * h
    flow = 2.0 * driven / (held + np.sqrt(held**2 + 4.0 * driven) + 1e-300)
    b.vent = min(flow, most) if b.pressure > 0.0 else -flow
    raise_pressure(b, -h * b.vent * (taken if b.vent > 0.0 else brought))


def flow(balloons, tubes, h):
    """Let gas flow through tubes and openings, by the pressures at the step's end, which all change together."""
    flows, open_ones = np.zeros(len(tubes)), [b for b in balloons if b.opening + b.p.leak > 0.0]
    for b in balloons:
        b.vent = 0.0
    for _ in range(8 if len(tubes) > 1 or (len(tubes) and open_ones) else 1):
        for k, (first, second, conductance) in enumerate(tubes):
            source = first if first.pressure > second.pressure else second
            moles = [there(source.free_volume / source.amount, b, b.temperature) for b in (first, second)]
            most = [max(b.amount - b.least, 0.0) / h for b in (first, second)]
            softness = moles[0] * first.slope + moles[1] * second.slope
            more = conductance * (first.pressure - second.pressure) - flows[k]
            more = np.clip(flows[k] + more / (1.0 + conductance * h * softness), -most[1], most[0]) - flows[k]
            flows[k] += more
            raise_pressure(first, -h * more * moles[0])
            raise_pressure(second, h * more * moles[1])
        for b in open_ones:
            vent(b, h)
    for rate, (first, second, _) in zip(flows, tubes, strict=True):
        source, sink = (first, second) if rate > 0.0 else (second, first)
        moles, taken = min(h * abs(rate), source.amount), source.free_volume / max(source.amount, 1e-20)
        inside = source.outside + source.pressure, sink.outside + sink.pressure
        source.amount, source.free_volume = source.amount - moles, max(source.free_volume - moles * taken, 0.0)
        sink.amount += moles
        sink.free_volume += moles * throttled(taken, *inside, first.p.gamma)
    for b in balloons:
        if b.vent:
            take(b, -h * b.vent)
