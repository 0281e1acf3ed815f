"""The scene that a bare mesh gets: it inflates gently above a floor, everything scaled to the mesh's size."""

import math
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.files import legible, whole_path
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.mesh.prepare import prepared
from balloon_warp.mesh.size import require_size
from balloon_warp.mesh.standing import standing, up_said
from balloon_warp.mesh.units import METERS, as_told
from balloon_warp.scene.pins import pinned_at_borders
from balloon_warp.scene.schema import Balloon, Inflation

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
    mesh = as_told(read, balloon.unit, balloon.up or (guess and guess[0]))
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
    up = up_said(mesh, balloon.up is not None, guess)
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
