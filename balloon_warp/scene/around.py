"""The scene around a bare mesh, or around foil balloons: everything scaled to their size."""

import colorsys
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import Parts, load_mesh, place_mesh, prepared
from balloon_warp.mesh.orientation import pushes
from balloon_warp.mesh.polygon_mesh import METERS, Color, Looks, with_unit_and_up
from balloon_warp.mesh.thickness import standing, up_axis_sentence
from balloon_warp.mesh.topology import (
    border_edges,
    corner_faces,
    face_areas,
    face_starts,
    mesh_edges,
    require_size,
    signed_volume,
    vertex_components,
)
from balloon_warp.scene.balloon import Balloon, Inflation, Stiffness
from balloon_warp.scene.scene import Body, Obstacle, Picture, Scene, String
from balloon_warp.system.files import legible, whole_path

MOST = 0.5
"""Fraction of a mesh's area in open parts from which on they are pinned at their borders"""


def pinned_at_borders(mesh: PolygonMesh, parts: Parts) -> NDArray[np.int64]:
    """Find the particles on the borders of open parts, in order; of a part without others, those of its first face.

    None where most of the surface is of closed parts, or where parts are free and some of them are closed: pins
    would leave those to fall. Faces that go all around something count as closed, with fins on them, too.

    Args:
        mesh: as it is simulated.
        parts: whether springs hold its components together.
    """
    edges = mesh_edges(mesh)
    component = vertex_components(mesh, edges)
    border = np.unique(edges.ends[border_edges(edges)])
    is_open = np.zeros(mesh.vertex_count, dtype=bool)
    is_open[component[border]] = True
    first_corners = mesh.face_vertex_indices[face_starts(mesh)]
    of_faces = component[first_corners]
    areas = face_areas(mesh)
    loose = is_open[of_faces] & (pushes(mesh, edges) == 0) if is_open.any() else is_open[of_faces]
    falls = not loose.all() if parts == "free" else areas[loose].sum() < MOST * areas.sum()
    if falls:
        return np.zeros(0, dtype=np.int64)
    used = np.unique(mesh.face_vertex_indices)
    has_others = np.zeros(mesh.vertex_count, dtype=bool)
    has_others[component[np.setdiff1d(used, border)]] = True
    _, first_faces = np.unique(of_faces, return_index=True)
    alone = first_faces[is_open[of_faces[first_faces]] & ~has_others[of_faces[first_faces]]]
    corners = np.isin(corner_faces(mesh), alone)
    return np.union1d(border[has_others[component[border]]], mesh.face_vertex_indices[corners])


BALLOON_COLORS: list[Color] = [
    *[(0.80, 0.07, 0.06), (0.05, 0.30, 0.75), (0.95, 0.50, 0.03), (0.10, 0.50, 0.16)],
    *[(0.42, 0.10, 0.58), (0.03, 0.52, 0.52), (0.88, 0.16, 0.40), (0.90, 0.72, 0.08)],
]
GOLDEN = 0.618034
"""Step on the circle of hues from one balloon to the next, once these colors are used up"""
SPHERE_COLORS: list[Color] = [(0.06, 0.16, 0.45), (0.85, 0.60, 0.05), (0.08, 0.40, 0.35), (0.45, 0.10, 0.35)]
BODY_COLORS: list[Color] = [(0.50, 0.28, 0.10), (0.30, 0.34, 0.40), (0.42, 0.42, 0.16), (0.40, 0.16, 0.12)]
STRING_COLOR: Color = (0.25, 0.20, 0.16)
OBSTACLE_COLOR: Color = (0.45, 0.45, 0.47)
FORCE_COLOR: Color = (0.02, 0.05, 0.25)
GROUND_COLOR: Color = (0.72, 0.70, 0.66)
WATER_COLOR: Color = (0.06, 0.40, 0.52)


def palette_color(number: int) -> Color:
    """Return the palette's color for a number: each balloon has another."""
    if number < len(BALLOON_COLORS):
        return BALLOON_COLORS[number]
    return colorsys.hsv_to_rgb(GOLDEN * number % 1.0, 0.85, 0.75)


def balloon_color(scene: Scene, number: int) -> Color:
    """Return the color of a balloon: its own, or the palette's for its number."""
    return scene.balloon[number].color or palette_color(number)


def paper_of(scene: Scene) -> Color:
    """Return the color of the ground and the backdrop."""
    return (scene.picture and scene.picture.paper) or GROUND_COLOR


def looks_of_file(mesh: PolygonMesh | None, said: Balloon | Obstacle | Body) -> Looks | None:
    """Return the looks of a mesh's file, where they count: a color or print in the scene has precedence."""
    covered = said.color is not None or (isinstance(said, Balloon) and said.print is not None)
    return None if mesh is None or covered else mesh.looks


def mean_color(mesh: PolygonMesh | None, said: Balloon | Obstacle | Body, otherwise: Color) -> Color:
    """Return the looks of a thing as one color.

    Args:
        otherwise: its color where its mesh's file says none, or less than the scene.
    """
    looks = looks_of_file(mesh, said)
    return otherwise if looks is None else looks.mean(otherwise)


PRESSURE = 50.0
"""Pressure [Pa]"""
FILL_SECONDS = 1.0
STIFFNESS_OVER_HEIGHT = 300.0
"""Constant of structural springs per meter of height [N/m^2], as the forces on them grow with it"""
AREAL_DENSITY = 1.0
"""Areal density of a sheet [kg/m^2]: more than foil has, so that steps are long"""
DAMPING_RATE = 1.0
"""Damping rate [1/s]"""
HELIUM = 9.3
"""Lift that carries nearly all of the weight [m/s^2]: foil itself weighs almost nothing"""
TOP = 0.25
"""Fraction of a part's height, at the top, in which it is held at its left and its right"""
HANGING = 0.5
"""Length of strings above the highest part, over the height of all parts"""
COLORS = ((0.75, 0.1, 0.2), (0.9, 0.55, 0.05), (0.1, 0.45, 0.2), (0.1, 0.3, 0.7), (0.45, 0.15, 0.55), (0.85, 0.3, 0.5))


def scene_of_foil(meshes: Mapping[Path, PolygonMesh], height: float) -> Scene:
    """Return each mesh a balloon that hangs on two strings, and that a pressure fills, which grows for a second.

    Foil hardly stretches: its springs are as stiff as its height asks for, and let it bend freely.

    Args:
        meshes: flat sheets sewn at the rim, by the files that they are in.
        height: of all of them [m].
    """
    stiffness = STIFFNESS_OVER_HEIGHT * height
    balloons, strings = [], []
    ceiling = max(float(mesh.points[:, 1].max()) for mesh in meshes.values()) + HANGING * height
    for number, (path, mesh) in enumerate(meshes.items()):
        mass = float(f"{AREAL_DENSITY * face_areas(mesh).sum():.2g}")
        balloons.append(
            Balloon(
                mesh=path,
                mass=mass,
                damping=DAMPING_RATE * mass,
                helium=HELIUM,
                color=COLORS[number % len(COLORS)],
                look="foil",
                stiffness=Stiffness(structural=stiffness, shear=0.5 * stiffness, flexion=0.0),
                inflation=Inflation(kind="pressure", pressure=[(0.0, 0.0), (FILL_SECONDS, PRESSURE)]),
            )
        )
        for held in places_to_hold(mesh):
            x, _, z = mesh.points[held].tolist()
            anchor = (float(f"{x:.6g}"), float(f"{ceiling:.6g}"), float(f"{z:.6g}"))
            strings.append(String(anchor=anchor, balloon=number, particle=held, stiffness=stiffness, knot=False))
    return Scene(
        description="Foil balloons fill as they hang, and wrinkle at their rims",
        balloon=balloons,
        string=strings,
        picture=Picture(azimuth=12.0, elevation=20.0),
    )


def places_to_hold(mesh: PolygonMesh) -> tuple[int, int]:
    """Return the vertices by which a part hangs upright: the leftmost and the rightmost of its top."""
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    top = np.flatnonzero(y >= y.max() - TOP * np.ptp(y))
    return int(top[np.argmin(x[top])]), int(top[np.argmax(x[top])])


GRAVITY = 9.81
"""Gravitational acceleration [m/s^2]"""
WEIGHT = 0.32
"""Weight of a balloon less its lift [N/kg]; where gravity grows with the size, for each meter of it: the balloon's
pressure carries it on its legs"""
WEIGHT_OF_OTHERS = 1.81
"""Weight of a balloon with gas, which has its own lift, or with normal forces [N/kg]"""
STRETCH = 0.08
"""Stretch of a sphere's skin, a volume of 1.26, at which faces, feet and folds keep their shape"""
MOLAR_VOLUME = 0.02406
"""Molar volume of a gas in the default atmosphere [m^3/mol]"""
MOST_FLOW = 9e11
"""Largest flow of a pump [mol/s]: kilometer-sized balloons get less than they need"""


def scene_table_around(
    source: Path | PolygonMesh, balloon: Balloon, up_axis: str | None, gravity: float | None
) -> dict[str, Any]:
    """Make a scene's table for a mesh, or the mesh of a file.

    Forces and lengths grow with the mesh's size, and springs are alike, so that a mesh of any size has the same shapes.
    Where its unit is known, gravity is true, masses grow with the size, and time with its root. Where it is not,
    masses are alike and accelerations grow, gravity, too: a mesh in centimeters moves as one in meters does.

    A closed mesh falls a little, onto the floor. An open one is held at its borders: its inflation, which nothing
    balances there, would drive it away.

    Args:
        balloon: the placement, the unit and the kind of inflation of the mesh.
        up_axis: "Y" or "Z"; the mesh's own when missing.
        gravity: that is asked for [m/s^2], and so is not told.

    Raises:
        InputError: the mesh cannot be read, has no face or no size, or its size or place is too much for float32.
    """
    label = source.name if isinstance(source, PolygonMesh) else source
    read = prepared(load_mesh(source, balloon.prim), label, balloon.treatment)
    guess = standing(read, source.suffix) if isinstance(source, Path) and balloon.up is None else None
    mesh = with_unit_and_up(read, balloon.unit, balloon.up or (guess and guess[0]))
    up_axis = up_axis or mesh.up_axis
    placed = place_mesh(mesh, up_axis, balloon.scale, balloon.rotation, balloon.position)
    points = placed.points[placed.face_vertex_indices]
    lowest, highest = points.min(axis=0), points.max(axis=0)
    size = float((highest - lowest).max())
    if size == 0.0:
        raise InputError(f"{label}: all vertices coincide; expected a mesh with an extent")
    require_size(placed, label)
    kind = balloon.inflation.kind
    weight = WEIGHT if kind == "pressure" else WEIGHT_OF_OTHERS
    lift, fall = (0.0, weight) if kind == "gas" else (GRAVITY - weight, GRAVITY)  # gas has its own
    growth = GRAVITY / fall if mesh.unit_known else size  # of accelerations, beside a mesh of one meter
    mass = _short(2.0 * size / growth)
    return {
        "description": _description(
            legible(source.name),
            mesh,
            size,
            fall * growth if gravity is None else None,
            _as_taken(mesh, balloon, up_axis, guess and guess[1]),
        ),
        "up_axis": up_axis,
        "gravity": _short(fall * growth),
        "frames": 120,
        "balloon": [
            {
                "mesh": source if isinstance(source, PolygonMesh) else whole_path(source),
                **({"prim": balloon.prim} if balloon.prim else {}),
                **({"up": guess[0]} if guess else {}),
                "mass": mass,
                "helium": _short(lift * growth),
                "damping": _short(10.0 * (2.0 * mass) ** 0.5),
                "stiffness": {"structural": 80.0, "shear": 40.0, "flexion": 16.0, "even": True, "thin": "tied"},
                "inflation": _gentle(balloon.inflation, placed, size),
                "fixed": pinned_at_borders(mesh, balloon.parts).tolist(),
            }
        ],
        "ground": {"height": _short(float(lowest["XYZ".index(up_axis)]) - 0.05 * size, size)},
    }


def _as_taken(mesh: PolygonMesh, balloon: Balloon, up_axis: str, guess: str | None) -> str:
    """Return a sentence on the up axis and the unit of the mesh, and their sources.

    A missing unit is reported elsewhere.

    Args:
        guess: why this axis is up, where the file does not say it.
    """
    up = up_axis_sentence(mesh, balloon.up is not None, guess)
    if mesh.up_axis != up_axis:
        up += f". It is turned to the scene's {up_axis}"
    if balloon.unit:
        return f". {up}. Its unit is {balloon.unit}, as given"
    unit = {meters: name for name, meters in METERS.items()}.get(mesh.meters_per_unit, f"{mesh.meters_per_unit:g} m")
    return f". {up}. Its unit is {unit}, as its file says" if mesh.unit_known else f". {up}"


def _description(name: str, mesh: PolygonMesh, size: float, gravity: float | None, taken: str) -> str:
    """Describe the default scene of a mesh, and the guesses in it.

    Args:
        size: of the mesh [m].
        gravity: that was chosen for it [m/s^2], if it was.
        taken: the mesh's up axis and unit, in sentences.
    """
    if mesh.unit_known:
        return f"{name}, {size:.3g} m across, inflates above a floor{taken}"
    if gravity is None:
        return f"{name} inflates above a floor{taken}"
    *units, last = METERS
    return (
        f"{name} inflates above a floor. Unit unknown: gravity scaled to {gravity:.4g} m/s2, so that it moves like "
        f"an object of 1 m. --unit {', '.join(units)} or {last} gives it true size and gravity{taken}"
    )


def _gentle(inflation: Inflation, placed: PolygonMesh, size: float) -> dict[str, Any]:
    """Make an inflation up to 1.5 s at most, which stretches the mesh a little.

    It is a pressure; or half as much gas again as fits into the mesh, unless it is said how much; or normal forces in
    proportion to the size.
    """
    if inflation.kind == "pressure":
        return {"stretch": STRETCH} if inflation.is_automatic else {}
    if inflation.kind == "normal_force":
        return {"k_normal": [[0.2, 0.0], [1.5, _short(4.0 * size)]]}
    if inflation.says_how_much:
        return {}
    flow = _short(min(0.5 * abs(signed_volume(placed)) / MOLAR_VOLUME / 1.2, MOST_FLOW))
    return {"pump": [[0.2, 0.0], [0.3, flow], [1.4, flow], [1.5, 0.0]]}


def _short(value: float, beside: float = 0.0) -> float:
    """Round a value to six digits, relative to another where given, so that people can read the scene file."""
    largest = abs(beside or value)
    return round(value, 5 - math.floor(math.log10(largest))) if largest else value
