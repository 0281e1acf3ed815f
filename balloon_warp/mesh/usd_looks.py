"""Base colors and base textures of a mesh of a USD stage."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.mesh.looks import Color, Look, Looks, Picture, looks_of
from balloon_warp.mesh.pictures import Pictures
from balloon_warp.mesh.usd_surfaces import (
    Image,
    at_corners,
    bound_surface,
    constant_of,
    content_of,
    display_colors,
    image_of,
    owners_of_faces,
    places_of,
    texture_coordinates,
)


class Seen(NamedTuple):
    """Looks and texture coordinates that were read of a mesh."""

    texture_coordinates: NDArray[np.float32] | None
    looks: Looks | None


def read_looks(
    geometry: UsdGeom.Mesh, counts: NDArray[np.int32], indices: NDArray[np.int32], pictures: Pictures
) -> Seen:
    """Read the looks of a mesh from the materials bound to it and to its subsets, else from its display colors."""
    prim = geometry.GetPrim()
    owners, of_faces = owners_of_faces(prim, len(counts))
    of_corners = np.repeat(of_faces, counts)
    places = texture_coordinates(geometry, "st", indices)
    looks: list[Look | None] = []
    for number, owner in enumerate(owners):
        surface = bound_surface(owner)
        image = image_of(surface)
        here = of_corners == number
        own = places_of(geometry, image, indices) if image else None
        picture = _read(image, pictures) if image and here.any() else None
        name = surface.GetPrim().GetParent().GetName() if surface else owner.GetName()
        if image and picture:
            look = Look(name, image.scale, picture)
            if own is None:
                look = pictures.mean_of(look, f"{image.named} of {prim.GetPath()}")
            else:
                places = np.zeros((len(indices), 2), np.float32) if places is None else places
                places = np.where(here[:, None], own, places)
            looks.append(look)
        else:
            color = constant_of(surface, "diffuseColor") if surface and _is_said(surface) else None
            looks.append(None if color is None else Look(name, _color(color)))
    return Seen(places, _with_display_colors(geometry, looks, counts, indices, of_corners))


def _with_display_colors(
    geometry: UsdGeom.Mesh,
    looks: list[Look | None],
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    of_corners: NDArray[np.int32],
) -> Looks | None:
    """Add display colors where no material says a color."""
    silent = np.array([look is None for look in looks])[of_corners]
    colors, interpolation = display_colors(geometry)
    if not silent.any() or not len(colors) or not np.isfinite(colors).all():
        return looks_of(looks, of_corners)
    points: Any = geometry.GetPointsAttr().Get() or geometry.GetPointsAttr().Get(Usd.TimeCode.EarliestTime())
    shades = at_corners(colors, interpolation, counts, indices, len(points))
    if shades is None:
        one = Look("displayColor", _color(colors.mean(axis=0)))
        return looks_of([*looks, one], np.where(silent, len(looks), of_corners))
    materials = looks_of(looks, of_corners)
    said = Looks((), np.full(len(indices), -1, np.int32)) if materials is None else materials
    return Looks(said.materials, said.of_corners, shades)


def _is_said(surface: Any) -> bool:
    given = surface.GetInput("diffuseColor")
    return bool(given) and (given.GetAttr().HasAuthoredValue() or given.HasConnectedSource())


def _color(value: Any) -> Color:
    red, green, blue = np.clip(np.asarray(value, np.float64), 0.0, 1.0).tolist()
    return red, green, blue


def _read(image: Image, pictures: Pictures) -> Picture | None:
    """Read an image from the package that it is in, or from its file."""
    if not image.path:
        return pictures.of_bytes(image.named, None)
    return pictures.of_bytes(image.named, content_of(image.path) or b"", Path(image.path))
