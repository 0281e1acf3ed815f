"""Meshes as they come from the wild: each with its defect, and the required outcome.

The tests hold every row to it, and the fuzzer begins with them.
"""

import gzip
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class MeshCase:
    """A mesh file, and its required outcome."""

    name: str
    content: Callable[[], bytes]
    """of the OBJ file"""
    outcome: Literal["refused", "accepted", "warned"]
    """refused with a sentence, exit status 2; made a balloon silently; or made a balloon with a warning"""
    says: str = ""
    """how the sentence goes on after the file's name, or how the warning begins"""
    overrides: tuple[tuple[str, object], ...] = ()
    """of the balloon's fields"""


CUBE_POINTS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\n"
CUBE_FACES = b"f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
CUBE = CUBE_POINTS + CUBE_FACES
"""the unit cube, winding outward: faces in lines 9 to 14"""
GAS = (("balloon.inflation.kind", "gas"),)


def _refused(name: str, content: bytes | Callable[[], bytes], says: str, *overrides: tuple[str, object]) -> MeshCase:
    return MeshCase(name, content if callable(content) else lambda: content, "refused", says, overrides)


def _accepted(name: str, content: bytes | Callable[[], bytes]) -> MeshCase:
    return MeshCase(name, content if callable(content) else lambda: content, "accepted")


def _warned(name: str, content: bytes | Callable[[], bytes], says: str, *overrides: tuple[str, object]) -> MeshCase:
    return MeshCase(name, content if callable(content) else lambda: content, "warned", says, overrides)


def obj(points: object, faces: object) -> bytes:
    """Return an OBJ file of points and faces, whose corners count from 0."""
    lines = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in np.asarray(points, dtype=np.float64).tolist()]
    lines += [f"f {' '.join(str(corner + 1) for corner in face)}\n" for face in faces]  # type: ignore[attr-defined]
    return "".join(lines).encode()


def cube_of(scale: float = 1.0, shift: float = 0.0) -> bytes:
    """Return the cube, scaled and moved along x."""
    points = np.array([line.split()[1:] for line in CUBE_POINTS.splitlines()], dtype=np.float64)
    return obj(points * scale + [shift, 0.0, 0.0], []) + CUBE_FACES


def one_big_face(corners: int = 100_000) -> bytes:
    """Return a disk of a single face."""
    turn = 2.0 * np.pi * np.arange(corners) / corners
    return obj(np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1), [range(corners)])


def fan_at_an_edge(faces: int = 100) -> bytes:
    """Triangles that share the edge from vertex 1 to 2, as pages share the spine of a book."""
    turn = 2.0 * np.pi * np.arange(faces) / faces
    rims = np.stack([np.cos(turn), np.sin(turn), np.full(faces, 0.5)], axis=1)
    return obj(np.concatenate([[(0, 0, 0), (0, 0, 1)], rims]), [(0, 1, 2 + page) for page in range(faces)])


def hub(quads: int = 5000) -> bytes:
    """Quads around vertex 1, a cone with its rim open."""
    turn = np.pi * np.arange(2 * quads) / quads
    rim = np.stack([np.cos(turn), np.sin(turn), np.full(2 * quads, -0.5)], axis=1)
    corners = [(0, 1 + 2 * n, 2 + 2 * n, 1 + (2 * n + 2) % (2 * quads)) for n in range(quads)]
    return obj(np.concatenate([[(0, 0, 0)], rim]), corners)


def moebius(quads: int = 12) -> bytes:
    """Return a strip that closes with half a turn."""
    turn = 2.0 * np.pi * np.arange(quads) / quads
    sides = []
    for width in (-0.3, 0.3):
        reach = 1.0 + width * np.cos(turn / 2.0)
        sides.append(np.stack([reach * np.cos(turn), reach * np.sin(turn), width * np.sin(turn / 2.0)], axis=1))
    faces = [(n, n + 1, quads + n + 1, quads + n) for n in range(quads - 1)]
    return obj(np.concatenate(sides), [*faces, (quads - 1, quads, 0, 2 * quads - 1)])


def seams() -> bytes:
    """Return the cube as six quads that share no vertex."""
    points = CUBE_POINTS.splitlines(keepends=True)
    faces = [[int(corner) - 1 for corner in line.split()[1:]] for line in CUBE_FACES.splitlines()]
    return b"".join(b"".join(points[corner] for corner in face) + b"f -4 -3 -2 -1\n" for face in faces)


def with_lines(*lines: bytes, at: int = 14) -> bytes:
    """Return the cube with more lines after so many of its own."""
    own = CUBE.splitlines(keepends=True)
    return b"".join([*own[:at], *(line + b"\n" for line in lines), *own[at:]])


def without_face(number: int) -> bytes:
    """Return the cube without a face, from 1."""
    return b"".join(line for n, line in enumerate(CUBE.splitlines(keepends=True)) if n != 7 + number)


def with_face(number: int, corners: bytes) -> bytes:
    """Return the cube with a face, from 1, that has other corners."""
    lines = CUBE.splitlines(keepends=True)
    lines[7 + number] = b"f " + corners + b"\n"
    return b"".join(lines)


def inside_out() -> bytes:
    """Return the cube with all its faces wound inward."""
    faces = [line.split()[1:] for line in CUBE_FACES.splitlines()]
    return CUBE_POINTS + b"".join(b"f " + b" ".join(reversed(face)) + b"\n" for face in faces)


def pierced() -> bytes:
    """Return a cube of 8 by 8 quads a side, without one of them."""
    places, faces = {}, []
    for axis in range(3):
        for side in (0, 8):
            for i in range(8):
                for j in range(8):
                    square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    corners = [np.roll((side, *corner), axis) for corner in square[:: 1 if side else -1]]
                    faces.append([places.setdefault(tuple(corner.tolist()), len(places)) for corner in corners])
    return obj(np.array(list(places)) / 8.0, faces[:27] + faces[28:])


def two_cubes() -> bytes:
    """Two cubes, apart along z."""
    faces = [[int(corner) - 9 for corner in line.split()[1:]] for line in CUBE_FACES.splitlines()]
    second = CUBE_POINTS.replace(b" 1\n", b" 4\n").replace(b" 0\n", b" 3\n")
    return CUBE + second + b"".join(b"f %d %d %d %d\n" % tuple(face) for face in faces)


LONG_COMMENT = b"# " + b"f 1 2 x \\ " * 1_600_000 + b"\n"
"""16 MB"""
NO_NUMBER = "coordinates must be decimal numbers"
NOT_FINITE = "coordinates must be finite and fit in 32-bit floats"
NO_INTEGER = "vertex numbers must be integers"
OPEN = ": an open mesh cannot hold gas; the first open edge goes from vertex 1"

REFUSED = [
    _refused("empty", b"", ": has no vertices"),
    _refused("no vertices", CUBE_FACES, ": has no vertices"),
    _refused("no faces", CUBE_POINTS, ": has no faces"),
    _refused("NaN", with_lines(b"v nan 0 0"), f", line 15: {NOT_FINITE}"),
    _refused("infinite", with_lines(b"v 0 -inf 0", at=2), f", line 3: {NOT_FINITE}"),
    _refused("past float32", with_lines(b"v 0 0 3.5e38"), f", line 15: {NOT_FINITE}"),
    _refused("past float64", with_lines(b"v 0 0 1e400"), f", line 15: {NOT_FINITE}"),
    _refused("a broken exponent", with_lines(b"v 3.1+e2 0 0"), f", line 15: {NO_NUMBER} (got 'v 3.1+e2 0 0')"),
    _refused("decimal commas", with_lines(b"v 1,5 0,5 0,5"), f", line 15: {NO_NUMBER} (got 'v 1,5 0,5 0,5')"),
    _refused("two coordinates", with_lines(b"v 1 2"), ", line 15: a vertex needs three coordinates, not 2"),
    _refused("index 0", with_lines(b"f 0 1 2"), ", line 15: vertex numbers begin at 1, not 0"),
    _refused("index past the end", with_lines(b"f 1 2 9"), ", line 15: there is no vertex 9, the file has 8"),
    _refused("index before the start", with_lines(b"f 1 2 -9"), ", line 15: there is no vertex -9, only 8 stand above"),
    _refused("index over 32 bits", with_lines(b"f 1 2 4294967298"), ", line 15: there is no vertex 4294967298, which"),
    _refused("index of a thousand digits", with_lines(b"f 1 2 " + b"9" * 1000), ", line 15: there is no vertex 999999"),
    _refused("index of a million digits", with_lines(b"f 1 2 " + b"9" * 1_000_000), f", line 15: {NO_INTEGER}"),
    _refused("fraction for an index", with_lines(b"f 1 2 3.5"), f", line 15: {NO_INTEGER} (got 'f 1 2 3.5')"),
    _refused("word for an index", with_lines(b"f 1 2 three"), f", line 15: {NO_INTEGER} (got 'f 1 2 three')"),
    _refused("face of two corners", with_lines(b"f 1 2"), ", line 15: a face needs three corners or more, not 2"),
    _refused("face of one corner", with_lines(b"f 1", at=9), ", line 10: a face needs three corners or more, not 1"),
    _refused("face of no corner", with_lines(b"f"), ", line 15: a face needs three corners or more, not 0"),
    _refused("binary", b"\x7fELF\x02\x01\x00" + CUBE, ": is binary or UTF-16"),
    _refused("UTF-16", CUBE.decode().encode("utf-16"), ": is binary or UTF-16"),
    _refused("UTF-16 without a mark", CUBE.decode().encode("utf-16-be"), ": is binary or UTF-16"),
    _refused("compressed with gzip", lambda: gzip.compress(CUBE, mtime=0), ": is compressed (gzip)"),
    _refused("compressed with zip", b"PK\x03\x04" + CUBE, ": is compressed (zip)"),
    _refused("compressed with Zstandard", b"\x28\xb5\x2f\xfd" + CUBE, ": is compressed (Zstandard)"),
    _refused(
        "face of 100,000 corners", one_big_face, ", line 100001: a face may have at most 4,096 corners, not 100,000"
    ),
    _refused("only faces of two vertices", CUBE_POINTS + b"f 1 2 1\n", ": has no face with three different corners"),
    _refused("all vertices at one place", lambda: cube_of(0.0), ": all vertices coincide"),
    _refused("1e6 from the origin", lambda: cube_of(1.0, 1e6), ": is 1 m across and 1e+06 m from the origin, too far"),
    _refused("a scale of 1e-18", lambda: cube_of(1e-18), ": is 1e-18 m across; expected 1e-06 to 1e+09 m"),
    _refused("a scale of 1e18", lambda: cube_of(1e18), ": is 1e+18 m across; expected 1e-06 to 1e+09 m"),
    _refused("gas in a Moebius strip", moebius, f"{OPEN} to 2, counting from 1; expected a closed mesh or", *GAS),
    _refused("gas in an open mesh", without_face(3), f"{OPEN} to 2, counting from 1; expected a closed mesh or", *GAS),
    _refused(
        "gas behind open seams",
        seams,
        f"{OPEN} to 2, counting from 1; expected --weld, which closes it, or",
        *GAS,
        ("balloon.weld", False),
    ),
]
ACCEPTED = [
    _accepted("plain", CUBE),
    _accepted("CRLF", CUBE.replace(b"\n", b"\r\n")),
    _accepted("bare CR", CUBE.replace(b"\n", b"\r")),
    _accepted("byte-order mark", b"\xef\xbb\xbf" + CUBE),
    _accepted("tabs", CUBE.replace(b" ", b"\t")),
    _accepted("no final newline", CUBE.rstrip()),
    _accepted("continued lines", CUBE.replace(b"f 1 ", b"f \\\n1 \\\n")),
    _accepted("continued a million times", lambda: CUBE.replace(b"f 1 3", b"f " + b"\\\n" * 1_000_000 + b"1 3")),
    _accepted("16 MB of comment in a line", lambda: LONG_COMMENT + CUBE + LONG_COMMENT),
    _accepted("f inside names and comments", b"# f 1 2\no f 0\ng f\nusemtl f 1\n" + CUBE + b"# f\n#f 9 9 9"),
    _accepted("NaN in colors", CUBE.replace(b" 0\n", b" 0 nan nan nan\n")),
    _accepted("Latin-1 comments", b"# caf\xe9 \xfc\xdf\n" + CUBE + b"g K\xf6rper\n"),
    _accepted("groups that take turns", CUBE.replace(b"f 1", b"g a\nf 1").replace(b"f 5", b"g b c\ns 1\nf 5")),
    _accepted("a library of materials", b"mtllib gone.mtl ../../secret.mtl\nusemtl a\n" + CUBE),
]
WARNED = [
    _warned("repeated corner", with_face(2, b"5 6 6 8 7"), "1 face repeats a corner; it is face 2"),
    _warned("zero-area face", with_lines(b"v 0.5 0 0", b"f 1 9 2", at=8), "1 face has no area; it is face 1,"),
    _warned(
        "an edge of no length", with_lines(b"v 0 0 0", b"f 9 1 2", at=8), "1 vertex along seams, exactly on another,"
    ),
    _warned(
        "coincident vertices",
        with_lines(b"v 0 0 0", b"f 9 1 2", at=8),
        "1 vertex lies exactly on another; it is",
        ("balloon.weld", False),
    ),
    _warned("unused vertices", with_lines(b"v 5 5 5", b"v 6 6 6"), "2 vertices belong to no face; the first is vertex"),
    _warned("duplicate face", with_lines(b"f 2 4 8 6"), "1 face has the corners of an earlier face; it is face 7"),
    _warned("duplicate face, wound the other way", with_lines(b"f 6 8 4 2"), "1 face has the corners of an earlier"),
    _warned("mixed winding", with_face(2, b"7 8 6 5"), "4 edges join faces of opposite winding; the first"),
    _warned(
        "mixed winding, open",
        without_face(6).replace(b"f 5 6 8 7", b"f 7 8 6 5"),
        "3 edges join faces of opposite winding; the first",
    ),
    _warned("inward winding", inside_out, "1 closed component winds inward; it has face 1, counting from 1. Such"),
    _warned("no winding fits", moebius, "1 edge joins faces of opposite winding; it goes from vertex"),
    _warned("open border", without_face(3), "4 edges are on open borders; the first goes from vertex 1 to 2"),
    _warned("seams", seams, "16 vertices along seams, exactly on others, have been welded to them"),
    _warned("welded seams", seams, "16 vertices that lay exactly on others have been welded", ("balloon.weld", True)),
    _warned("open seams", seams, "16 vertices lie exactly on others; the first is vertex", ("balloon.weld", False)),
    _warned("several components", two_cubes, "2 separate parts (the second starts at face 7)"),
    _warned("components that are free", two_cubes, "2 separate parts (the second", ("balloon.parts", "free")),
    _warned("a pinhole", pierced, "1 hole in the surface is closed by faces numbered after the file's; it has 4"),
    _warned("a hole that is kept", pierced, "4 edges are on open borders", ("balloon.holes", "keep")),
    _warned("an edge of 100 faces", fan_at_an_edge, "1 edge has more than two faces; it goes from vertex 1 to 2"),
    _warned("a hub of 5,000 quads", hub, "1 vertex has more than 256 neighbors; it is vertex 1"),
]
MESH_CASES = [*REFUSED, *ACCEPTED, *WARNED]
