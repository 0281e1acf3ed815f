"""Files beside a balloon's mesh: individual springs, and the stress-free shape."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.scene import Balloon
from balloon_warp.springs import Springs
from balloon_warp.springs.springs import SpringKind

Values = NDArray[np.float64]
COLUMNS = ("pairs", "rest_lengths", "constants")
"""Arrays in a file of springs"""


def springs_told(path: Path, own: Springs, mesh: PolygonMesh, constants: Values, unit: float) -> tuple[Springs, Values]:
    """Return the springs of a file, and the scale of each one's constant over that of its kind.

    A spring between particles that the mesh would join has the kind of that; others are structural.

    Args:
        own: the springs of the mesh.
        constants: of the three kinds [N/m].
        unit: meters in the file's unit of length.

    Raises:
        InputError: the file cannot be read, or does not fit the mesh.
    """
    pairs, lengths, stiffness = _columns(path)
    _require_springs(path, pairs, lengths, stiffness, mesh.vertex_count)
    pairs = np.sort(pairs, axis=1).astype(np.int32)
    kind = _kinds(pairs, own)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], kind))
    of_kind = constants[kind]
    if (none := (of_kind == 0.0) & (stiffness > 0.0)).any():
        name = SpringKind(int(kind[none][0])).name.lower()
        raise InputError(f"stiffness.{name}: is 0, which {path} cannot scale; expected more than 0")
    scale = np.divide(stiffness, of_kind, out=np.zeros(len(kind)), where=of_kind > 0.0)
    return Springs(pairs[order], kind[order], unit * lengths[order]), scale[order]


def rest_shape(balloon: Balloon, placed: PolygonMesh, unit: float) -> PolygonMesh:
    """Return the stress-free mesh: the balloon's own, the vertices of another, or its faces cut into panels.

    Raises:
        InputError: the other mesh cannot be read, or has neither the same vertices nor, of a film, the same faces.
    """
    path = balloon.material.rest_mesh
    if path is None:
        return placed
    other = load_mesh(path)
    if len(other.points) == placed.vertex_count:
        return replace(placed, points=unit * other.points)
    sewn_vertices(other, placed, path, balloon.material.is_membrane)
    return replace(other, points=unit * other.points)


def sewn_vertices(panels: PolygonMesh, sewn: PolygonMesh, source: object, film: bool = True) -> NDArray[np.int64]:
    """Return the vertex of a mesh that each vertex of its panels is sewn to, shape (panels.vertex_count,).

    Args:
        panels: the same faces in the same order, of which some do not share their vertices any longer.
        film: whether panels are taken at all: springs go from panel to panel.

    Raises:
        InputError: the panels are no cut mesh.
    """
    told = f"material.rest_mesh: {source} has {panels.vertex_count} vertices"
    same = f"expected the {sewn.vertex_count} of {sewn.name}, in its order"
    if not film:
        raise InputError(f"{told}; {same}")
    if not np.array_equal(panels.face_vertex_counts, sewn.face_vertex_counts):
        raise InputError(
            f"{told} and {panels.face_count} faces; {same}, or panels: its {sewn.face_count} faces, in its order, cut "
            "along seams"
        )
    sewn_to = np.zeros(panels.vertex_count, dtype=np.int64)
    sewn_to[panels.face_vertex_indices] = sewn.face_vertex_indices
    if (wrong := sewn_to[panels.face_vertex_indices] != sewn.face_vertex_indices).any():
        vertex = panels.face_vertex_indices[wrong][0] + 1
        raise InputError(
            f"material.rest_mesh: vertex {vertex} of {source}, counted from 1, would be sewn to several of "
            f"{sewn.name}; expected one"
        )
    return sewn_to


def _columns(path: Path) -> list[NDArray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return [np.asarray(file[name], dtype=np.int64 if name == "pairs" else np.float64) for name in COLUMNS]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected the .npz file of springs") from None
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile):
        expected = "a .npz file with pairs, rest_lengths and constants"
        raise InputError(f"{path}: cannot be read as springs; expected {expected}") from None


def _require_springs(path: Path, pairs: NDArray, lengths: Values, constants: Values, count: int) -> None:
    """Raise unless the springs fit so many particles."""
    if pairs.ndim != 2 or pairs.shape[1] != 2 or lengths.shape != constants.shape or lengths.shape != pairs.shape[:1]:
        shapes = f"{pairs.shape}, {lengths.shape} and {constants.shape}"
        raise InputError(f"{path}: expected pairs of shape (m, 2), and m rest_lengths and constants (got {shapes})")
    if len(pairs) and (pairs.min() < 0 or pairs.max() >= count or (pairs[:, 0] == pairs[:, 1]).any()):
        raise InputError(f"{path}: pairs: expected two of the mesh's {count} particles each, counted from 0")
    if len(np.unique(np.sort(pairs, axis=1), axis=0)) != len(pairs):
        raise InputError(f"{path}: pairs: two springs join the same particles; expected each pair once")
    for name, values in (("rest_lengths", lengths), ("constants", constants)):
        if not np.isfinite(values).all() or (values < 0.0).any():
            raise InputError(f"{path}: {name}: expected numbers of at least 0")


def _kinds(pairs: NDArray[np.int32], own: Springs) -> NDArray[np.int32]:
    """Return the kind of each pair among the mesh's own springs; structural where there is none."""
    keys = (own.pairs[:, 0].astype(np.int64) << 32) + own.pairs[:, 1]
    order = np.argsort(keys)
    wanted = (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1]
    at = np.minimum(np.searchsorted(keys[order], wanted), max(len(keys) - 1, 0))
    if not len(keys):
        return np.zeros(len(pairs), dtype=np.int32)
    found = keys[order][at] == wanted
    return np.where(found, own.kind[order][at], int(SpringKind.STRUCTURAL)).astype(np.int32)
