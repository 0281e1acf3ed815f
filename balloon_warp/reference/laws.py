"""Laws as formulas of NumPy arrays: forces [N] on n particles at x [m] with velocities v [m/s], shape (n, 3).

A table that a law takes, such as `springs`, has the fields that it names; docs/PHYSICS.md has the formulas and sources.
"""

from collections.abc import Callable
from math import erf
from typing import Any

import numpy as np

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


def springs(x, v, springs, viscosity=0.0, yield_stretch=np.inf, limit=None):
    """Hooke's law, viscous, and none beyond the yield stretch (Tarantino 1996); gone at the limit of a correction."""
    p, q = springs.pairs.T
    d, opening = x[q] - x[p], v[q] - v[p]
    strain = 1.0 - springs.lengths / size(d)
    pull = np.where(strain > 1.0 - 1.0 / yield_stretch, 0.0, strain + viscosity * dot(d, opening) / size(d) ** 2)
    if limit is not None:  # it gives way smoothly
        pull = pull * (1.0 - np.clip((size(d) / springs.lengths - 1.0) / limit, 0.0, 1.0) ** 2) ** 2
    force = springs.constants * pull * d
    return summed(len(x), p, force) - summed(len(x), q, force)


def shortened(x, v, springs, share, limit, h):
    """Shorten springs beyond the limit, one after another, and let velocities follow (Provot 1995)."""
    x, v = x.copy(), v.copy()
    for p, q, length in springs.corrected:
        d = x[q] - x[p]
        excess = max(1.0 - (1.0 + limit) * length / max(np.sqrt(d @ d), 1e-150), 0.0) * d
        for end, other, sign in ((p, q, 1.0), (q, p, -1.0)):
            part = sign * (0.0 if share[end] == 0.0 else 0.5 if share[other] > 0.0 else 1.0)
            x[end], v[end] = x[end] + part * excess, v[end] + part * excess / h
    return x, v


def pulls_of_strings(x, held, anchors, lengths, constants):
    """Springs from anchors to the particles held, while taut."""
    d = anchors - x[held]
    return constants * np.maximum(1.0 - lengths / size(d), 0.0) * d


def strings(x, held, *told):
    return summed(len(x), held, pulls_of_strings(x, held, *told))


def torsion(x, hinges, constant):
    """Minus the constant times the angle beyond that at rest, times its gradient; a wing is the mean of its corners."""
    p, q = hinges.ends.T
    edge, first, second = x[q] - x[p], hinges.first @ x - x[p], hinges.second @ x - x[p]
    normals = np.cross(edge, first), np.cross(second, edge)
    length, sine = size(edge), dot(np.cross(*normals), edge)
    beyond = np.arctan2(sine / length, dot(*normals)) - hinges.rest
    moment, force = constant * (beyond - 2.0 * np.pi * np.round(beyond / (2.0 * np.pi))), np.zeros_like(x)
    for wing, arm, normal in zip((hinges.first, hinges.second), (first, second), normals, strict=True):
        push, along = moment * length / dot(normal, normal) * normal, dot(arm, edge) / length**2
        force += wing.T @ push - summed(len(x), p, (1.0 - along) * push) - summed(len(x), q, along * push)
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


MEMBRANES: dict[str, Callable[..., Any]] = {law.__name__: law for law in (neo_hookean, mooney_rivlin, ogden, gent)}


def larger(a, b):
    """Return the larger of two numbers, with its derivative by complex steps."""
    return np.where(np.real(a) > np.real(b), a, b)


def relaxed(energy, a, b, p):
    """Return the least energy density over all wrinkles (Pipkin 1986)."""
    if p.wrinkling:
        a = larger(a, 1.0)
        b = larger(b, a**-0.5)
    return energy(a, b, p)


def membrane(x, v, film, peak, p):
    """Return forces of triangles, and the greatest energy densities so far, from which they are softened (Mullins).

    F = U diag(a, b) V^T is the deformation gradient, and F = volume dW/dF; viscosity is that of a fluid (Kelvin-Voigt).
    """
    edges = [of[film.corners[:, 1:]] - of[film.corners[:, :1]] for of in (x, v)]
    gradient, change = (np.einsum("tex,tef->txf", each, film.inverse) for each in edges)
    frames, stretches, turns = np.linalg.svd(gradient, full_matrices=False)
    a, b = stretches.T
    stress = np.zeros((len(a), 2, 2))
    stress[:, 0, 0] = relaxed(film.energy, a + 1j * STEP, b, p).imag / STEP
    stress[:, 1, 1] = relaxed(film.energy, a, b + 1j * STEP, p).imag / STEP
    rate = np.einsum("txi,txf,tjf->tij", frames, change, turns) / stretches[:, None]
    rate = 0.5 * (rate + rate.transpose(0, 2, 1))
    flow = 2.0 * (rate + np.trace(rate, axis1=1, axis2=2)[:, None, None] * np.eye(2))
    if p.wrinkling:  # where it wrinkles only the tension's direction flows, and where it is slack nothing
        one_way = np.where((a > 1.0)[:, None, None], 3.0 * rate * [[1.0, 0.0], [0.0, 0.0]], 0.0)
        flow = np.where((b > np.maximum(a, 1.0) ** -0.5)[:, None, None], flow, one_way)
    stress += p.film_viscosity * flow / stretches[:, None]
    density = np.maximum(relaxed(film.energy, a, b, p), 0.0)
    peak = np.maximum(peak, density)
    worn = (peak - density) / (p.softening_energy + p.softening_share * peak)
    left = 1.0 - p.softening * np.array([erf(each) for each in worn])
    pulls = np.einsum("t,txi,tij,tjf,tef->tex", left * film.areas * p.thickness, frames, stress, turns, film.inverse)
    corners = np.concatenate([-pulls.sum(axis=1, keepdims=True), pulls], axis=1)
    return -summed(len(x), film.corners.ravel(), corners.reshape(-1, 3)), peak


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


def wind(x, time, up, p, waves):
    """Return the air's velocity: a power law or a logarithmic one of height, and gusts that it carries along."""
    height, growth = dot(x, up), 1.0
    if p.wind_roughness > 0.0:
        z = np.clip(height, p.wind_roughness, 10.0 * p.wind_height) / p.wind_roughness
        growth = np.log(z) / np.log(max(p.wind_height / p.wind_roughness, 1.0 / 0.99))
    elif p.wind_shear > 0.0:
        growth = np.clip(height / p.wind_height, 0.0, 10.0) ** p.wind_shear
    turns = (x - time * p.wind) / p.gust_length @ waves.vectors.T + waves.phases
    part = turns - np.floor(turns) - 0.5
    arch = part * (16.0 * np.abs(part) - 8.0)  # nearly a sine
    gusts = (arch * (0.775 + 0.225 * np.abs(arch))) @ waves.amplitudes
    return growth * p.wind + p.gusts * np.linalg.norm(p.wind) * gusts


def drag(u, area, density, coefficient):
    """1/2 density C_d (u . n)^2 for each area, u the velocity beside the air."""
    flux = dot(u, area)
    return -0.5 * density * coefficient * flux * np.abs(flux) / np.maximum(dot(area, area), 1e-30) * area


def face_air(x, v, faces, wind_at, density_at, normal, tangential):
    """Lift and drag of faces (Wejchert and Haumann 1991), which their corners share."""
    centers, area = faces.means @ x, face_areas(x, faces)
    u = faces.means @ v - wind_at(centers)
    across = dot(u, area) / size(area) ** 2 * area
    push = normal * across + tangential * (u - across)
    return faces.means.T @ (-0.5 * density_at(centers) * size(area) * size(u) * push)


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


def water(x, v, faces, share, up, p):
    """Hydrostatic pressure and drag on the wetted part of all fans (Kim et al. 2006), and k of the drag -k |v| v.

    Of the pressure a part acts evenly, by shares of the mass.
    """
    a, b, c = fans(x, faces)
    area = 0.5 * np.cross(a - c, b - c)
    moments, parts = wet_means(p.water_level - np.hstack([dot(each, up) for each in (a, b, c)]))
    load = shared(faces, *(moments[:, k : k + 1] * area for k in range(3)))
    wet = shared(faces, *(parts[:, k : k + 1] * size(area) for k in range(3)))
    k = 0.5 * p.water_density * p.water_drag * wet
    if p.water_evened > 0.0:
        inside, around = volume(x, faces)
        depth = max(p.water_level - share @ (x @ up), 0.0)
        left = p.air_pressure / (p.air_pressure + p.water_density * p.gravity * depth)
        part = max(p.water_evened, np.clip((0.97 - left) / 0.05, 0.0, 1.0))
        lift = -(load @ up).sum()
        part *= np.clip(lift / (0.2 * inside), 0.0, 1.0)
        load = load + part * (depth * around - share[:, None] * lift * up - load)
    return -p.water_density * p.gravity * load - k * size(v) * v, k


def resisted(v, force, push, k, gain):
    """Velocity without a push, and gain, of m dv/dt = force + push - k |v| v over a step, as along a line."""
    t = np.maximum(gain * np.sqrt(k * size(force + push)), 1e-9)
    gain = gain * np.tanh(t) / t
    slower = 1.0 / (1.0 + gain * k * size(v))
    return slower * (v + gain * force), slower * gain
