"""Random legal scenes: hypothesis strategies, by a kind that fixes the features that kernels are compiled for.

A scene is drawn in units of its own: a length, a mass and a stiffness over six decades, and so a time. All else is
drawn as a multiple of these, so that a scene tiny or huge in meters is as lively as a ball of one meter.
"""

from collections.abc import Callable
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.internal.conjecture.providers import HypothesisProvider

from balloon_warp.benchmarks.physics_meshes import Draw, meshes

DECADES = 3.0
"""Powers of ten on either side of one, of length, mass and stiffness"""
AIR_PRESSURE = 101325.0
"""Pressure of the air [Pa], to which those of balloons have any ratio"""


class Kind(NamedTuple):
    """Features of a batch of scenes, and so its kernels: numbers may be tiny, but no feature is left out."""

    mesh: str = "quads"
    """ "quads" of closed meshes, "triangles" or an open "sheet" """
    balloons: int = 1
    inflation: str = "pressure"
    material: str = "springs"
    spheres: int = 0
    obstacles: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    strings: int = 0
    ground: bool = False
    water: bool = False
    air: bool = False
    """Air outside, with wind and drag; else vacuum, without damping"""
    touch: bool = False
    torsion: bool = False
    moves: bool = False
    """Obstacles move and turn"""
    changes: bool = False
    """Values change over time, and gas is pumped"""
    bursts: bool = False
    correction: str = "none"
    tubes: bool = False
    """Gas flows from the first balloon to the second, and out through a neck"""


KINDS = {
    "springs": Kind(),
    "gas": Kind(inflation="gas"),
    "rubber": Kind("triangles", material="neo_hookean", inflation="gas"),
    "film": Kind("sheet", material="mooney_rivlin", torsion=True, air=True),
    "spheres": Kind(inflation="gas", spheres=2, ground=True),
    "obstacles": Kind("triangles", obstacles=("box", "capsule"), moves=True, air=True, changes=True),
    "touch": Kind("triangles", 3, touch=True),
    "pressed": Kind(inflation="gas", obstacles=("lid",), ground=True, moves=True),
    "bodies": Kind(inflation="gas", bodies=("box", "capsule"), ground=True),
    "water": Kind(inflation="gas", water=True, air=True),
    "strings": Kind(strings=2, air=True, changes=True, torsion=True),
    "bursting": Kind("triangles", material="neo_hookean", inflation="gas", bursts=True),
    "paper": Kind(inflation="normal_force", correction="provot", torsion=True),
    "tubes": Kind(balloons=2, inflation="gas", air=True, tubes=True),
    "all": Kind(
        "triangles", 2, "gas", "springs", 1, ("box",), ("box",), 1, *(True,) * 4, torsion=True, moves=True, changes=True
    ),
}
"""Kinds by name, which between them have all that a scene can have"""


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers spread evenly over powers of ten; the simplest is the one nearest to 1."""
    return st.floats(low, high, width=32).map(lambda power: float(f"{10.0**power:.4g}"))


def signed(most: float) -> st.SearchStrategy[float]:
    """Return numbers from -most to most, of three digits."""
    return st.integers(-200, 200).map(lambda number: number * most / 200.0)


def vectors(most: float) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(*[signed(most)] * 3)


class Units(NamedTuple):
    """Units that a scene is drawn in."""

    length: float
    """[m]"""
    mass: float
    """[kg]"""
    stiffness: float
    """[N/m]"""

    @property
    def time(self) -> float:
        """Return the time in which a spring swings [s]."""
        return float((self.mass / self.stiffness) ** 0.5)

    @property
    def speed(self) -> float:
        return self.length / self.time

    @property
    def pressure(self) -> float:
        return self.stiffness / self.length


@st.composite
def scenes(draw: Draw, kind: Kind) -> dict[str, Any]:
    """Draw the tables of a scene of a kind; they may still be refused, as when things overlap at the start."""
    most = 0.5 if kind.bodies or kind.spheres else DECADES  # these take 480 steps a second, however slow the rest is
    units = Units(draw(decades(-DECADES, DECADES)), draw(decades(-DECADES, DECADES)), 1.0)
    units = units._replace(stiffness=float(f"{units.mass * draw(decades(-most, most)):.4g}"))
    if kind.tubes:  # pressures that drive a flow are far above the rounding of the air's, 0.01 Pa
        units = units._replace(stiffness=float(f"{1.0e3 * units.length * draw(decades(0, DECADES)):.4g}"))
    length, time = units.length, units.time
    frames = draw(st.integers(2, 60))
    tables: dict[str, Any] = {
        "gravity": draw(st.sampled_from((0.0, 0.3, 2.0))) * length / time**2,
        "frames": frames,
        "frames_per_second": 1.0 / (time * draw(st.sampled_from((0.3, 0.1, 1.0)))),
        "substeps": "auto",
        "contact": "impulse",
        "correction": kind.correction,
        "faces": False,
        "touch": {"friction": draw(st.sampled_from((0.3, 0.0)))} if kind.touch else False,
        "atmosphere": {
            "pressure": AIR_PRESSURE,
            "density": draw(decades(-4, 0)) * units.mass / length**3 if kind.air or kind.water else 0.0,
        },
        "balloon": [_balloon(draw, kind, units, number) for number in range(kind.balloons)],
        "sphere": [_sphere(draw, units, number) for number in range(kind.spheres)],
        "obstacle": [_obstacle(draw, kind, units, shape, n) for n, shape in enumerate(kind.obstacles)],
        "body": [_body(draw, units, shape, number) for number, shape in enumerate(kind.bodies)],
        "string": [_string(draw, kind, units, number) for number in range(kind.strings)],
    }
    if kind.air:
        tables["atmosphere"]["wind"] = tuple(number * units.speed for number in draw(vectors(0.3)))
    if kind.ground:
        tables["ground"] = {"height": -0.8 * length, "friction": draw(st.sampled_from((0.5, 0.0)))}
    if kind.water:
        tables["water"] = {
            "level": draw(signed(1.0)) * length,
            "density": draw(decades(-2, 2)) * units.mass / length**3,
        }
    if kind.correction != "none":
        tables["correction_limit"] = draw(st.sampled_from((0.1, 0.02, 0.5)))
    if kind.tubes:
        flow = _moles(units) / (time * units.pressure)
        tables["tube"] = [{"balloons": (0, 1), "conductance": flow * draw(decades(-4, -1))}]
        gases = [balloon["inflation"] for balloon in tables["balloon"]]
        molar_mass = max(0.1 * tables["balloon"][0]["mass"] / _moles(units), 0.002)  # none is lighter than hydrogen
        for gas in gases:
            gas |= {"gamma": gases[0]["gamma"], "molar_mass": molar_mass}
        tables["balloon"][0]["neck"] = {"diameter": length * draw(decades(-3, -1)), "discharge": 0.9}
    if kind.changes:
        when = frames // 2 * 1.0 / tables["frames_per_second"]
        tables["change"] = [{"time": when, "set": {"gravity": 0.1 * length / time**2}}]
    return tables


def drawn(kind: Kind, examples: int, number: int, hold: Callable[[dict[str, Any]], None]) -> None:
    """Call a function with the tables of random scenes of a kind; where it raises, with smaller ones until it is over.

    Args:
        number: seed of the scenes; the same gives the same.

    Raises:
        Exception: as raised by the function for the smallest scene.
    """
    settle = settings(
        max_examples=examples,
        database=None,
        deadline=None,
        report_multiple_bugs=False,
        suppress_health_check=[*HealthCheck],  # pyright: ignore
        phases=(Phase.generate, Phase.shrink),
    )
    # Hypothesis also draws numbers that it reads in the modules imported so far: a seed would not fix the scenes.
    with mock.patch.object(HypothesisProvider, "_maybe_draw_constant", return_value=None):
        settle(seed(number)(given(scenes(kind))(hold)))()


def _balloon(draw: Draw, kind: Kind, units: Units, number: int) -> dict[str, Any]:
    rubber = kind.material != "springs"
    mass, stiffness = units.mass * draw(decades(-1, 1)), units.stiffness * draw(decades(-1, 1))
    pressure = draw(st.sampled_from((0.05, 0.0, 0.3, -0.03, 1.0))) * units.pressure
    thickness = units.length * draw(decades(-4, -2))
    balloon: dict[str, Any] = {
        "mesh": draw(meshes(kind.mesh)),
        "name": f"balloon{number}",
        "scale": units.length,
        "position": _apart(draw, units, number),
        "rotation": draw(vectors(180.0)),
        "velocity": tuple(units.speed * each for each in draw(vectors(0.3))),
        "angular_velocity": tuple(each / units.time for each in draw(vectors(0.5))),
        "damping": units.mass / units.time * draw(decades(-3, -1)) if kind.air else 0.0,
        "stiffness": {
            "structural": stiffness,
            "shear": stiffness * draw(st.sampled_from((0.5, 0.0, 2.0))),
            "flexion": stiffness * draw(decades(-2, 0)),
            "torsion": stiffness * units.length**2 * draw(decades(-3, -1)) if kind.torsion and not rubber else 0.0,
            "viscosity": units.time * draw(decades(-4, -2)),
        },
    }
    if rubber:
        modulus, density = stiffness / thickness, mass / (thickness * units.length**2)
        balloon["material"] = {
            "kind": kind.material, "shear_modulus": modulus, "thickness": thickness, "density": density,
            "wrinkling": draw(st.booleans()), "most_stretch": 2.5,
        }  # fmt: skip
        balloon["stiffness"] = {}
        if kind.bursts:
            balloon["material"]["strength"] = modulus * draw(decades(-1, 1))
    else:
        balloon["mass"] = mass
    if kind.air:
        balloon["drag_coefficient"] = draw(st.sampled_from((0.5, 0.01)))
    if kind.inflation == "gas":
        balloon["inflation"] = {
            "kind": "gas", "start_pressure": pressure, "gamma": draw(st.sampled_from((1.0, 1.4))),
            "molar_mass": draw(st.sampled_from((0.0, 0.1, 1.0))) * mass / _moles(units),
        }  # fmt: skip
        if kind.changes:
            flow = draw(st.sampled_from((0.03, -0.03))) * _moles(units) / units.time
            balloon["inflation"]["pump"] = [[0.0, flow], [3.0 * units.time, 0.0]]
    elif kind.inflation == "pressure":
        balloon["inflation"] = {"kind": "pressure", "pressure": max(pressure, 0.0)}
    else:
        balloon["inflation"] = {"kind": "normal_force", "k_normal": 0.01 * pressure * units.length**2}
    return balloon


def _moles(units: Units) -> float:
    """Return the gas that a balloon encloses at about the air's pressure [mol]."""
    return AIR_PRESSURE * 0.5 * units.length**3 / (8.314 * 293.15)


def _apart(draw: Draw, units: Units, slot: int) -> tuple[float, ...]:
    """Return a place for a thing, beside others: balloons are in the first slots, then spheres, bodies, obstacles."""
    turn = 2.4 * slot
    center = np.array([1.3 * np.cos(turn), 0.4 * slot, 1.3 * np.sin(turn)]) if slot else np.zeros(3)
    return tuple(float(each) for each in units.length * (center + draw(vectors(0.15))))


def _moving(draw: Draw, units: Units) -> dict[str, Any]:
    return {
        "rotation": draw(vectors(180.0)),
        "velocity": tuple(units.speed * each for each in draw(vectors(0.5))),
        "angular_velocity": tuple(each / units.time for each in draw(vectors(0.5))),
    }


def _sphere(draw: Draw, units: Units, number: int) -> dict[str, Any]:
    moving = _moving(draw, units)
    return {
        "position": _apart(draw, units, 4 + number),
        "radius": 0.3 * units.length,
        "mass": units.mass * draw(decades(-DECADES, DECADES)),
        "friction": draw(st.sampled_from((0.3, 0.01))),
        "restitution": draw(st.sampled_from((0.3, 0.0, 1.0))),
        "velocity": moving["velocity"],
        "angular_velocity": moving["angular_velocity"],
    }


def _solid(draw: Draw, units: Units, shape: str) -> dict[str, Any]:
    wide = [units.length * draw(st.sampled_from((0.5, 0.3, 1.0))) for _ in range(3)]
    own = {"size": tuple(wide)} if shape == "box" else {"radius": 0.5 * wide[0], "length": wide[1]}
    return {"shape": shape, "friction": draw(st.sampled_from((0.5, 0.01))), **own}


def _body(draw: Draw, units: Units, shape: str, number: int) -> dict[str, Any]:
    return {
        **_solid(draw, units, shape), **_moving(draw, units),
        "position": _apart(draw, units, 6 + number), "mass": units.mass * draw(decades(-1, 1)),
        "restitution": draw(st.sampled_from((0.3, 1.0))),
    }  # fmt: skip


def _obstacle(draw: Draw, kind: Kind, units: Units, shape: str, number: int) -> dict[str, Any]:
    if shape == "lid":  # comes down on a balloon, to a hundredth of its size above the ground at the lowest
        way = (0.0, -units.length * draw(st.sampled_from((1.3, 1.7, 1.79))), 0.0)
        end = units.time * draw(st.sampled_from((5.0, 2.0)))
        return {
            "shape": "box", "size": (4.0 * units.length, units.length, 4.0 * units.length),
            "position": (0.0, 1.5 * units.length, 0.0), "rotation": (0.0, 0.0, 0.0),
            "motion": [[0.0, (0.0, 0.0, 0.0)], [end, way]],
        }  # fmt: skip
    x, y, z = _apart(draw, units, 1 + number)
    obstacle = {
        **_solid(draw, units, shape),
        "position": (x, y - 1.5 * units.length, z),
        "rotation": draw(vectors(180.0)),
    }
    if kind.moves:
        shift = tuple(units.length * each for each in draw(vectors(0.5)))
        turn = (0.0, draw(signed(90.0)), 0.0)
        obstacle["motion"] = [[0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)], [5.0 * units.time, shift, turn]]
    return obstacle


def _string(draw: Draw, kind: Kind, units: Units, number: int) -> dict[str, Any]:
    return {
        "anchor": tuple(units.length * each for each in draw(vectors(2.0))),
        "balloon": number % kind.balloons,
        "particle": draw(st.integers(0, 5)),
        "length": units.length * draw(st.sampled_from((1.0, 0.5, 2.0))),
        "stiffness": units.stiffness * draw(decades(-1, 1)),
    }
