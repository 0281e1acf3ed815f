"""OBJ files: every form that must be read, and the result of reading."""

import os
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import grid, prism, quad_sphere
from work import lines_executed

from balloon_warp.errors import InputError
from balloon_warp.mesh.obj import read_obj, write_obj

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
SQUARE_POINTS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]

# Each is the square above as one quad, written in another way.
FORMS = {
    "plain": SQUARE + b"f 1 2 3 4\n",
    "no final newline": SQUARE + b"f 1 2 3 4",
    "weights": b"v 0 0 0 1.0\nv 1 0 0 1\nv 1 1 0 1\nv 0 1 0 1\nf 1 2 3 4\n",
    "colors": b"v 0 0 0 .1 .2 .3\nv 1 0 0 1 1 1\nv 1 1 0 0 0 0\nv 0 1 0 1e-3 0 0\nf 1 2 3 4\n",
    "weights and colors": b"v 0 0 0 1 .1 .2 .3\nv 1 0 0 1 1 1 1\nv 1 1 0 1 0 0 0\nv 0 1 0 1 0 0 0\nf 1 2 3 4\n",
    "forms of numbers": b"v 0 -0.0 +0\nv 1e0 0. .0\nv 10E-1 +1.0 0\nv 0e5 1.000 0\nf 1 2 3 4\n",
    "texture coordinates": SQUARE + b"vt 0 0\nvt 1 1\nf 1/1 2/2 3/1 4/2\n",
    "normals": SQUARE + b"vn 0 0 1\nf 1//1 2//1 3//1 4//1\n",
    "texture coordinates and normals": SQUARE + b"vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\n",
    "negative indices": SQUARE + b"f -4 -3 -2 -1\n",
    "negative indices with normals": SQUARE + b"vn 0 0 1\nf -4//-1 -3//-1 -2//-1 -1//-1\n",
    "mixed indices": SQUARE + b"f 1 -3 3/7 -1\n",
    "a face above its vertices": b"f 1 2 3 4\n" + SQUARE,
    "inline comments": b"v 0 0 0 # first\nv 1 0 0#second\nv 1 1 0\nv 0 1 0\nf 1 2 3 4 # v 9 9 9\n# f 1 2 3\n",
    "continued lines": b"v 0 \\\n0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n  3 \\\n 4\n",
    "a continued line at the end": SQUARE + b"f 1 2 3 4 \\",
    "a comment that ends in a backslash": b"# C:\\models\\\n" + SQUARE + b"f 1 2 3 4\n",
    "a byte order mark": b"\xef\xbb\xbf" + SQUARE + b"f 1 2 3 4\n",
    "leading blanks and tabs": b"  v 0 0 0\n\tv\t1\t0\t0\nv  1   1  0 \t\nv 0 1 0\n \t f\t1 2  3 4\t\n\n\n",
    "Latin-1": b"# caf\xe9\no \xfcber_all\n" + SQUARE + b"usemtl gr\xfcn\nf 1 2 3 4\n",
    "names with underscores": b"o my_mesh\ng a_1\n" + SQUARE + b"f 1 2 3 4\n",
    "a library of materials that is not there": b"mtllib gone.mtl\n" + SQUARE + b"usemtl a\nf 1 2 3 4\n",
    "lines, points and curves": SQUARE + b"l 1 2\np 3\nvp 1 2\ncstype bezier\ncurv 0 1 1 2\nf 1 2 3 4\n",
}


def read(tmp_path: Path, content: bytes):
    (tmp_path / "mesh.obj").write_bytes(content)
    return read_obj(tmp_path / "mesh.obj")


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize("form", FORMS)
def test_forms(tmp_path: Path, form: str, line_end: bytes) -> None:
    mesh = read(tmp_path, FORMS[form].replace(b"\n", line_end))
    assert mesh.points.tolist() == SQUARE_POINTS
    assert mesh.face_vertex_counts.tolist() == [4]
    assert mesh.face_vertex_indices.tolist() == [0, 1, 2, 3]
    assert (mesh.points.dtype, mesh.face_vertex_indices.dtype) == (np.float64, np.int32)
    assert (mesh.name, mesh.up_axis, mesh.meters_per_unit, mesh.warnings) == ("mesh", "Y", 1.0, ())


def test_polygons_objects_and_unused_vertices_stay_in_place(tmp_path: Path) -> None:
    content = b"""o first
v 9 9 9
v 0 0 0
v 1 0 0
v 1 1 0
g a
usemtl one
f 2 3 4
o second
v 0 1 0
v 0 2 0
s 1
usemtl two
f -5 -4 -3 -2 -1
"""
    mesh = read(tmp_path, content)
    assert mesh.points[:, 1].tolist() == [9, 0, 0, 1, 1, 2]
    assert mesh.face_vertex_counts.tolist() == [3, 5]
    assert mesh.face_vertex_indices.tolist() == [1, 2, 3, 1, 2, 3, 4, 5]


def test_negative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"
    assert read(tmp_path, triangle * 3).face_vertex_indices.tolist() == list(range(9))


TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
BAD = {
    "empty": (b"", ": has no vertices (no line begins with v)"),
    "no vertices": (b"f 1 2 3\nvn 0 0 1\n", ": has no vertices (no line begins with v)"),
    "no faces": (TRIANGLE, ": has no faces (no line begins with f)"),
    "NaN": (b"v 0 0 0\nv nan 0 0\n" + TRIANGLE + b"f 1 2 3\n", ", line 2: coordinates must be finite"),
    "infinity": (TRIANGLE + b"v 0 -inf 0\nf 1 2 3\n", ", line 4: coordinates must be finite"),
    "float32 overflow": (b"v 0 0 3.5e38\n" + TRIANGLE + b"f 1 2 3\n", ", line 1: coordinates must be finite and fit"),
    "float64 overflow": (b"v 0 1e999 0\n" + TRIANGLE + b"f 1 2 3\n", ", line 1: coordinates must be finite"),
    "two coordinates": (
        TRIANGLE + b"v 1 2\nf 1 2 3\n",
        ", line 4: a vertex needs three coordinates, not 2 (got 'v 1 2')",
    ),
    "no coordinates": (b"v\n", ", line 1: a vertex needs three coordinates, not 0"),
    "no number": (b"#\n#\nv 3.1+e2 0 0\n", ", line 3: coordinates must be decimal numbers (got 'v 3.1+e2 0 0')"),
    "decimal commas": (b"v 1,5 2,5 3,5\n", ", line 1: coordinates must be decimal numbers (got 'v 1,5 2,5 3,5')"),
    "Python's digit groups": (b"v 1_0 0 0\n", ", line 1: coordinates must be decimal numbers"),
    "a word for a weight": (b"v 0 0 0 heavy\n", ", line 1: coordinates must be decimal numbers"),
    "index 0": (TRIANGLE + b"f 0 1 2\n", ", line 4: vertex numbers begin at 1, not 0 (got 'f 0 1 2')"),
    "past the end": (TRIANGLE + b"f 1 2 3\nf 1 2 4\n", ", line 5: there is no vertex 4, the file has 3"),
    "past the end, at a first corner": (
        TRIANGLE + b"f 1 2 3\nf 4 1 2\n",
        ", line 5: there is no vertex 4, the file has 3",
    ),
    "before the start": (TRIANGLE + b"f -1 -2 -4\n", ", line 4: there is no vertex -4, only 3 stand above this line"),
    "negative before its vertices": (b"f -1 -2 -3\n" + TRIANGLE, ", line 1: there is no vertex -1, only 0 stand above"),
    "fraction": (TRIANGLE + b"f 1 2 3.0\n", ", line 4: vertex numbers must be integers (got 'f 1 2 3.0')"),
    "no index": (TRIANGLE + b"f 1 2 /3\n", ", line 4: vertex numbers must be integers"),
    "grouped index": (TRIANGLE + b"f 1 2 0_3\n", ", line 4: vertex numbers must be integers"),
    "33 bits": (TRIANGLE + b"f 1 2 4294967297\n", ", line 4: there is no vertex 4294967297, which takes more than 32"),
    "80 bits": (TRIANGLE + b"f 1 2 1" + b"0" * 24 + b"\n", ", line 4: there is no vertex 1000000000000000000000000,"),
    "two corners": (TRIANGLE + b"f 1 2\n", ", line 4: a face needs three corners or more, not 2 (got 'f 1 2')"),
    "no corners": (TRIANGLE + b"f\n", ", line 4: a face needs three corners or more, not 0"),
    "a bad line after a continued one": (b"v 0 \\\n 0 \\\n 0\nv 1 x 0\n", ", line 4: coordinates must be decimal"),
    "UTF-16": ("v 0 0 0\n".encode("utf-16"), ": is binary or UTF-16, not the plain text of an OBJ file"),
    "UTF-16 without a mark": ("v 0 0 0\n".encode("utf-16-le"), ": is binary or UTF-16"),
    "binary": (b"\x7fELF\x02\x01\x00\x00v 0 0 0\n", ": is binary or UTF-16"),
}


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_refused_in_a_sentence(tmp_path: Path, case: str, line_end: bytes) -> None:
    content, sentence = BAD[case]
    with pytest.raises(InputError) as refusal:
        read(tmp_path, content.replace(b"\n", line_end) if b"\0" not in content else content)
    message = str(refusal.value)
    assert message.startswith(f"{tmp_path / 'mesh.obj'}{sentence}")
    assert "\n" not in message


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.obj: cannot be read \(No such file or directory\)"):
        read_obj(tmp_path / "gone.obj")


def test_writing_and_reading_gives_the_same_mesh(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    # All sizes of float64 that a float32 can hold, and values without a short decimal form.
    points = random.normal(size=(12, 3)) * 10.0 ** random.integers(-30, 30, size=(12, 3))
    points[0] = (1 / 3, np.nextafter(1.0, 2.0), -0.0)
    mesh = replace(prism(6), points=points)
    write_obj(tmp_path / "mesh.obj", mesh)
    again = read_obj(tmp_path / "mesh.obj")
    assert again.points.tobytes() == mesh.points.tobytes()
    assert again.face_vertex_counts.tolist() == mesh.face_vertex_counts.tolist()
    assert again.face_vertex_indices.tolist() == mesh.face_vertex_indices.tolist()


def test_writing_replaces_a_file_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mesh.obj"
    write_obj(path, grid(1, 1))
    before = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InputError, match=r"mesh\.obj: cannot be written: No space left on device"):
        write_obj(path, quad_sphere(3))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_writing_into_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        write_obj(tmp_path / "gone" / "mesh.obj", grid(1, 1))


def test_each_line_is_worked_on_once(tmp_path: Path) -> None:
    """Reading executes as much Python for each of ten thousand vertices as of a hundred."""
    counts = []
    for size in (10, 100):
        write_obj(tmp_path / "mesh.obj", grid(size, size))
        vertices_and_faces = (size + 1) ** 2 + size**2
        counts.append(lines_executed(lambda: read_obj(tmp_path / "mesh.obj")) / vertices_and_faces)
    assert counts[1] < 1.1 * counts[0]
    assert counts[1] < 25


TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
MANY = {
    "vertices": b"v 0 0 0\n" * 20_000 + TRIANGLE,
    "faces": TRIANGLE + b"f 1 2 3\n" * 20_000,
    "large faces": TRIANGLE + (b"f" + b" 1 2" * 2000 + b"\n") * 20,
    "empty comments": b"##\n" * 50_000 + TRIANGLE,
    "a long comment": b"# " * 50_000 + b"\n" + TRIANGLE,
    "returns": TRIANGLE + b"\r\n" * 50_000,
    "continued lines": TRIANGLE[:-1] + b"\\\n" * 50_000,
    "continued words": b"ab\\\n" * 50_000 + b"\n" + TRIANGLE,
    "words": b"vt" + b" 1" * 50_000 + b"\n" + TRIANGLE,
}


@pytest.mark.parametrize("what", MANY)
def test_reading_takes_a_few_times_the_memory_of_the_file(tmp_path: Path, what: str) -> None:
    """The peak memory is a few times the file: the shortest vertex line has 8 bytes, its numbers 28."""
    path = tmp_path / "mesh.obj"
    path.write_bytes(MANY[what])
    tracemalloc.start()
    read_obj(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 9 * path.stat().st_size + 50_000
