"""Laws as formulas of NumPy arrays: `LAWS` are forces [N] on a balloon's particles at x [m] with velocities v [m/s].

A balloon b has tables, such as `springs`, its parameters p, and the world's axis up, time and waves of gusts. A law
that does not act is 0. Formulas and sources are in docs/PHYSICS.md, docs/RUBBER.md and docs/FORMULAS.md.

Sealed gas of a balloon b: its pressure in a step, and gas that is pumped in, leaves by openings, and flows in tubes.

A gas has an amount n [mol], a free volume V0 [m^3] at one atmosphere and a gauge pressure [Pa]; see docs/GAS.md.
"""

from math import erf
from typing import NamedTuple

import numpy as np

R, ATMOSPHERE, DRY_AIR = 8.314462618, 101325.0, 0.0289652
"""Gas constant [J/(mol K)]; one atmosphere [Pa]; molar mass of dry air [kg/mol]"""
STEP = 1e-30
"""Step of complex differentiation, which has no rounding"""


def dot(a, b):
    """Return dot products of rows, shape (n, 1)."""
    return (a * b).sum(axis=-1, keepdims=True)


def size(a):
    """Return lengths of rows, shape (n, 1), never 0."""
    return np.maximum(np.sqrt(dot(a, a)), 1e-150)


def cross(a, b):
    """Return cross products, for few vectors in a third of the time of NumPy's."""
    after, before = [1, 2, 0], [2, 0, 1]
    return a[..., after] * b[..., before] - a[..., before] * b[..., after]


def across(vector, normal):
    """Return vectors without their parts along normals."""
    return vector - dot(vector, normal) * normal


def summed(count, rows, values):
    """Return the sums of the values of each row, shape (count, ...)."""
    total = np.zeros((count, *np.shape(values)[1:]))
    np.add.at(total, rows, values)
    return total


def weight(x, v, b):
    """Gravity, and the paper's helium, which lifts by its acceleration."""
    return b.share * b.p.mass * (b.p.helium - b.p.gravity) * b.world.up


def damping(x, v, b):
    """Damping of all motion, by shares of the mass."""
    return -b.share * b.p.damping * v


def springs(x, v, b):
    """Hooke's law, viscous, and none beyond the yield stretch (Tarantino 1996); gone at the limit of a correction."""
    (i, j), lengths = b.springs.pairs.T, b.springs.lengths
    d, opening = x[j] - x[i], v[j] - v[i]
    strain = 1.0 - lengths / size(d)
    pull = np.where(
        strain > 1.0 - 1.0 / b.p.yield_stretch, 0.0, strain + b.p.viscosity * dot(d, opening) / size(d) ** 2
    )
    if b.world.correction == "tarantino":  # it gives way smoothly
        pull = pull * (1.0 - np.clip((size(d) / lengths - 1.0) / b.p.correction_limit, 0.0, 1.0) ** 2) ** 2
    force = b.springs.constants * pull * d
    return summed(len(x), i, force) - summed(len(x), j, force)


def shortened(x, v, b, h):
    """Shorten springs beyond the limit, one after another, and let velocities follow (Provot 1995)."""
    x, v, free = x.copy(), v.copy(), b.share[:, 0] > 0.0
    for i, j, length in b.springs.corrected:
        d = x[j] - x[i]
        excess = max(1.0 - (1.0 + b.p.correction_limit) * length / max(np.sqrt(d @ d), 1e-150), 0.0) * d
        for end, other, sign in ((i, j, 1.0), (j, i, -1.0)):
            part = sign * (0.5 if free[other] else 1.0) * free[end]
            x[end], v[end] = x[end] + part * excess, v[end] + part * excess / h
    return x, v


def strings(x, anchors, lengths, constants):
    """Springs from anchors to particles at x, while taut."""
    d = anchors - x
    return constants * np.maximum(1.0 - lengths / size(d), 0.0) * d


def torsion(x, v, b):
    """Minus the constant times the angle beyond that at rest, times its gradient; a wing is the mean of its corners."""
    if not b.p.torsion:
        return 0.0
    i, j = b.hinges.ends.T
    edge, first, second = x[j] - x[i], b.hinges.first @ x - x[i], b.hinges.second @ x - x[i]
    normals = np.cross(edge, first), np.cross(second, edge)
    length, sine = size(edge), dot(np.cross(*normals), edge)
    beyond = np.arctan2(sine / length, dot(*normals)) - b.hinges.rest
    moment, force = b.p.torsion * (beyond - 2.0 * np.pi * np.round(beyond / (2.0 * np.pi))), np.zeros_like(x)
    for wing, arm, normal in zip((b.hinges.first, b.hinges.second), (first, second), normals, strict=True):
        push, along = moment * length / dot(normal, normal) * normal, dot(arm, edge) / length**2
        force += wing.T @ push - summed(len(x), i, (1.0 - along) * push) - summed(len(x), j, along * push)
    return force


def neo_hookean(a, b, p):
    """Energy density [J/m^3] at the stretches a and b (Treloar 1943)."""
    return 0.5 * p.shear_modulus * (a * a + b * b + (a * b) ** -2 - 3.0)


def mooney_rivlin(a, b, p):
    """Energy density (Rivlin 1948), C2 / C1 the ratio."""
    second = a**-2 + b**-2 + (a * b) ** 2 - 3.0
    return (neo_hookean(a, b, p) + 0.5 * p.shear_modulus * p.mooney_ratio * second) / (1.0 + p.mooney_ratio)


def ogden(a, b, p):
    """Energy density (Ogden 1972), the sum over three terms."""
    terms = zip(p.ogden_moduli, p.ogden_exponents, strict=True)
    return sum(mu / k * (a**k + b**k + (a * b) ** -k - 3.0) for mu, k in terms if k)


def gent(a, b, p):
    """Energy density (Gent 1996), beyond the most stretch's I1 of a tension that rises with the root of I1."""
    most, first = p.most_stretch, a * a + b * b + (a * b) ** -2
    room = max(p.gent_limit + 3.0 - 2.0 * most**2 - most**-4, 1e-3 * p.gent_limit)
    last = p.gent_limit + 3.0 - room
    s = np.sqrt(larger(first / last, 1.0))
    beyond = 2.0 * last / room * ((s - 1.0) + (1.0 + 2.0 * last / room) * 0.5 * (s - 1.0) ** 2)
    left = larger(p.gent_limit + 3.0 - first, room) / p.gent_limit
    return 0.5 * p.shear_modulus * p.gent_limit * (beyond - np.log(left))


MEMBRANES = {law.__name__: law for law in (neo_hookean, mooney_rivlin, ogden, gent)}


def larger(a, b):
    """Return the larger of two numbers, with its derivative by complex steps."""
    return np.where(np.real(a) > np.real(b), a, b)


def relaxed(energy, a, b, p):
    """Return the least energy density over all wrinkles (Pipkin 1986)."""
    if p.wrinkling:
        a = larger(a, 1.0)
        b = larger(b, a**-0.5)
    return energy(a, b, p)


def membrane(x, v, b):
    """Rubber: F = volume dW/dF of the deformation gradient U diag(a, b) V^T of each triangle.

    It softens from its greatest energy density so far (Mullins), and flows as a fluid (Kelvin-Voigt).
    """
    if b.film is None:
        return 0.0
    film, p = b.film, b.p
    edges = [of[film.corners[:, 1:]] - of[film.corners[:, :1]] for of in (x, v)]
    gradient, change = (np.einsum("tex,tef->txf", each, film.inverse) for each in edges)
    frames, stretches, turns = np.linalg.svd(gradient, full_matrices=False)
    first, second = stretches.T
    stress = np.zeros((len(first), 2, 2))
    stress[:, 0, 0] = relaxed(film.energy, first + 1j * STEP, second, p).imag / STEP
    stress[:, 1, 1] = relaxed(film.energy, first, second + 1j * STEP, p).imag / STEP
    rate = np.einsum("txi,txf,tjf->tij", frames, change, turns) / stretches[:, None]
    rate = 0.5 * (rate + rate.transpose(0, 2, 1))
    flow = 2.0 * (rate + np.trace(rate, axis1=1, axis2=2)[:, None, None] * np.eye(2))
    if p.wrinkling:  # where it wrinkles only the tension's direction flows, and where it is slack nothing
        one_way = np.where((first > 1.0)[:, None, None], 3.0 * rate * [[1.0, 0.0], [0.0, 0.0]], 0.0)
        flow = np.where((second > np.maximum(first, 1.0) ** -0.5)[:, None, None], flow, one_way)
    stress += p.film_viscosity * flow / stretches[:, None]
    density = np.maximum(relaxed(film.energy, first, second, p), 0.0)
    b.peak = np.maximum(b.peak, density)
    worn = (b.peak - density) / (p.softening_energy + p.softening_share * b.peak)
    left = (1.0 - p.softening * np.array([erf(each) for each in worn])) * film.areas * p.thickness
    pulls = np.einsum("t,txi,tij,tjf,tef->tex", left, frames, stress, turns, film.inverse)
    corners = np.concatenate([-pulls.sum(axis=1, keepdims=True), pulls], axis=1)
    return -summed(len(x), film.corners.ravel(), corners.reshape(-1, 3))


def fans(x, faces):
    """Return the corners of all triangles between a face's edges and its center, each of shape (m, 3)."""
    return x[faces.corners], x[faces.nexts], (faces.means @ x)[faces.of]


def shared(faces, at_corner, at_next, at_center):
    """Return the sums over particles of values at the corners of fans' triangles; all corners share the center's."""
    count = faces.means.shape[1]
    at_center = summed(len(faces.means), faces.of, at_center)
    return summed(count, faces.corners, at_corner) + summed(count, faces.nexts, at_next) + faces.means.T @ at_center


def volume(x, faces):
    """Return the enclosed volume [m^3], and its gradient by the particles' places, their area vectors [m^2]."""
    a, b, c = fans(x - x.mean(axis=0), faces)
    area = np.cross(b - a, c - a) / 6.0  # at each corner a third; of an open mesh, too
    return dot(a, np.cross(b, c)).sum() / 6.0, shared(faces, area, area, area)


def face_areas(x, faces):
    """Return the faces' area vectors [m^2], shape (f, 3)."""
    a, b, c = fans(x, faces)
    return summed(len(faces.means), faces.of, 0.5 * np.cross(a - c, b - c))


def normal_directions(x, faces):
    """Return the paper's (A_p / A_total) n: the area of the nearest face, and the mean of the unit normals around."""
    centers, areas = faces.means @ x, face_areas(x, faces)
    normals = summed(len(x), faces.corners, (areas / size(areas))[faces.of])
    ways = np.full((len(x), len(areas)), np.inf)
    ways[faces.corners, faces.of] = size(x[faces.corners] - centers[faces.of])[:, 0]
    return size(areas)[ways.argmin(axis=1)] / size(areas).sum() * normals / size(normals)


def air(height, p):
    """Return the air's pressure, temperature and density, at rest under gravity where it grows colder with height."""
    density = p.air_density if p.air_density >= 0.0 else DRY_AIR * p.air_pressure / (R * p.air_temperature)
    if p.air_lapse == -1.0:  # uniform
        return p.air_pressure, p.air_temperature, density + 0.0 * height
    part = np.minimum(p.air_lapse * height / p.air_temperature, 0.9)
    more = np.where(np.abs(part) > 1e-6, -np.log1p(-part) / np.where(part == 0.0, 1.0, part), 1.0 + 0.5 * part)
    ratio = np.exp(-density * p.gravity * height * more / p.air_pressure)
    return p.air_pressure * ratio, p.air_temperature * (1.0 - part), density * ratio / (1.0 - part)


def wind(x, b):
    """Return the air's velocity: a power law or a logarithmic one of height, and gusts that it carries along."""
    height, growth, p = dot(x, b.world.up), 1.0, b.p
    if p.wind_roughness > 0.0:
        z = np.clip(height, p.wind_roughness, 10.0 * p.wind_height) / p.wind_roughness
        growth = np.log(z) / np.log(max(p.wind_height / p.wind_roughness, 1.0 / 0.99))
    elif p.wind_shear > 0.0:
        growth = np.clip(height / p.wind_height, 0.0, 10.0) ** p.wind_shear
    turns = (x - b.world.time * p.wind) / p.gust_length @ b.world.waves.vectors.T + b.world.waves.phases
    part = turns - np.floor(turns) - 0.5
    arch = part * (16.0 * np.abs(part) - 8.0)  # nearly a sine
    gusts = (arch * (0.775 + 0.225 * np.abs(arch))) @ b.world.waves.amplitudes
    return growth * p.wind + p.gusts * np.linalg.norm(p.wind) * gusts


def drag(x, v, b):
    """Drag 1/2 density C_d (u . n)^2 of each particle's area, u the velocity beside the air."""
    if not b.p.drag_coefficient:
        return 0.0
    area, density = volume(x, b.faces)[1], air(dot(x, b.world.up), b.p)[2]
    flux = dot(v - wind(x, b), area)
    return -0.5 * density * b.p.drag_coefficient * flux * np.abs(flux) / np.maximum(dot(area, area), 1e-30) * area


def face_air(x, v, b):
    """Lift and drag of faces (Wejchert and Haumann 1991), which their corners share."""
    if not (b.p.face_drag or b.p.face_friction):
        return 0.0
    centers, area = b.faces.means @ x, face_areas(x, b.faces)
    u, density = b.faces.means @ v - wind(centers, b), air(dot(centers, b.world.up), b.p)[2]
    along = dot(u, area) / size(area) ** 2 * area
    push = b.p.face_drag * along + b.p.face_friction * (u - along)
    return b.faces.means.T @ (-0.5 * density * size(area) * size(u) * push)


def wet_means(depths):
    """Return the means over triangles of depth times barycentric coordinates, and of these, where depth is positive.

    The surface cuts off a piece at the corner that alone is wet, or alone is dry; it is linear in between.
    """
    wet = depths > 0.0
    count = wet.sum(axis=1)[:, None]
    order = (np.argmax(wet == (count == 1), axis=1)[:, None] + np.arange(3)) % 3
    d = np.where(count % 3 > 0, np.take_along_axis(depths, order, axis=1), [1.0, -1.0, -1.0])
    s, t = d[:, :1] / (d[:, :1] - d[:, 1:2]), d[:, :1] / (d[:, :1] - d[:, 2:])
    of_piece = np.hstack([4.0 - s - t, s, t]) * s * t * d[:, :1] / 12.0, np.hstack([3.0 - s - t, s, t]) * s * t / 3.0
    found = []
    for piece, whole in zip(of_piece, ((depths + depths.sum(axis=1, keepdims=True)) / 12.0, 1.0 / 3.0), strict=True):
        piece = np.take_along_axis(piece, np.argsort(order, axis=1), axis=1)
        found.append(np.select([count == 0, count == 1, count == 2], [0.0 * piece, piece, whole - piece], whole))
    return found


def wetted(x, b):
    """Return the fans' area vectors [m^2], and `wet_means` of their depths."""
    corners = fans(x, b.faces)
    area = 0.5 * np.cross(corners[0] - corners[2], corners[1] - corners[2])
    return area, *wet_means(b.p.water_level - np.hstack([dot(each, b.world.up) for each in corners]))


def water(x, v, b):
    """Hydrostatic pressure on the wetted part (Kim et al. 2006), of which a part acts evenly, by shares of the mass."""
    if not b.world.water:
        return 0.0
    (area, moments, _), p, up = wetted(x, b), b.p, b.world.up
    load = shared(b.faces, *(moments[:, k : k + 1] * area for k in range(3)))
    if p.water_evened > 0.0:
        inside, around = volume(x, b.faces)
        depth = max(p.water_level - b.share[:, 0] @ (x @ up), 0.0)
        left = p.air_pressure / (p.air_pressure + p.water_density * p.gravity * depth)
        lift = -(load @ up).sum()
        part = max(p.water_evened, np.clip((0.97 - left) / 0.05, 0.0, 1.0)) * np.clip(lift / (0.2 * inside), 0.0, 1.0)
        load = load + part * (depth * around - b.share * lift * up - load)
    return -p.water_density * p.gravity * load


def resistance(x, b):
    """Return k [kg/m] of the water's drag -k |v| v, by the wetted area of all fans."""
    if not b.world.water:
        return 0.0 * b.share
    area, _, parts = wetted(x, b)
    return (
        0.5
        * b.p.water_density
        * b.p.water_drag
        * shared(b.faces, *(parts[:, k : k + 1] * size(area) for k in range(3)))
    )


def jet(x, v, b):
    """Thrust 2 C A p of the gas that leaves a neck, on its rim."""
    if not b.opening:
        return 0.0
    edges, above = b.neck.edges, np.maximum(b.load + b.rise * (x @ b.world.up), 0.0)
    out = np.cross(x[edges[:, 0]], x[edges[:, 1]]).sum(axis=0)
    thrust = 2.0 * b.opening * above * nozzle(above, b.p.air_pressure + above, b.p.gamma)[1]
    return -(b.neck.weights * thrust)[:, None] * out / np.linalg.norm(out)


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


def resisted(v, force, push, k, gain):
    """Velocity without a push, and gain, of m dv/dt = force + push - k |v| v over a step, as along a line."""
    t = np.maximum(gain * np.sqrt(k * size(force + push)), 1e-9)
    gain = gain * np.tanh(t) / t
    slower = 1.0 / (1.0 + gain * k * size(v))
    return slower * (v + gain * force), slower * gain


LAWS = weight, damping, springs, membrane, torsion, drag, face_air, water, jet
"""Forces on a balloon's particles but for its inflation and contact"""
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


class Breath(NamedTuple):
    """Growth of a balloon's volume by a pressure P, at the rate r = rate + response P [m^3/s]."""

    volume: float
    response: float
    """Sum over its particles of the gain times the area squared [m^3/(Pa s)]"""
    rate: float
    """Growth without a pressure [m^3/s]"""
    height: float
    """Mean height of its particles by their shares [m]"""
    response_height: float
    """Sum of the response times height [m^4/(Pa s)]"""


def implicit_pressure(b, h, damping, breath):
    """Set the pressure P = p(V) - w s h r over a step, its load at height 0 and rise [Pa/m], and slope [Pa/m^3].

    s = -dp/dV, r = rate + response P the growth of the volume, by forces along all area vectors, and w its weight:
    backward Euler where breathing is damped, or the trapezoidal rule. Near empty the end's pressure is exact.
    """
    volume, response, rate, height, response_height = breath
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


def given_pressure(b, h, given, breath):
    """Set pressure and load of a balloon of a given one, raised where its volume would fall below a least one.

    On a flat skin in a liquid it rises with depth as the liquid does, and nothing turns inside out.
    """
    volume, response, rate, height, response_height = breath
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
