"""Agreement of `balloon-warp inspect` with the simulation."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inspecting import command, inside_out, with_faces
from meshes import cube, joined, quad_sphere

from balloon_warp.mesh.obj import write_obj


@pytest.mark.full
def test_what_is_simulated_is_reported_and_what_is_otherwise_in_the_file(tmp_path: Path) -> None:
    """Counts and measures are those of a run, with the file's beside them: all faces are twice and inward."""
    faces = inside_out(cube()).face_vertex_indices.reshape(-1, 4)
    write_obj(tmp_path / "twice.obj", with_faces(inside_out(cube()), *faces.tolist()))
    report = json.loads(command(tmp_path / "twice.obj", "--json").stdout)
    assert (report["faces"], report["quads"], report["manifold"], report["genus"]) == (6, 6, True, 0)
    assert (report["volume"], report["area"]) == pytest.approx((1.0, 6.0))
    in_file = {"faces": 12, "quads": 12, "manifold": False, "genus": None, "area": 12.0}
    assert report["in_file"] == {**in_file, "volume": pytest.approx(-2.0)}
    rows = [line.split() for line in command(tmp_path / "twice.obj").stdout.splitlines()]
    assert ["volume", "1", "cubic", "units;", "in", "the", "file:", "-2", "cubic", "units"] in rows
    rows = [line.split() for line in command(tmp_path / "twice.obj", "--unit", "cm").stdout.splitlines()]
    assert ["area", "6", "cm²;", "in", "the", "file:", "12", "cm²"] in rows
    (tmp_path / "twice.toml").write_text("[[balloon]]\nmesh = 'twice.obj'\nunit = 'm'\n")
    assert "12 m²" in command(tmp_path / "twice.toml").stdout


@pytest.mark.full
def test_a_report_has_the_seams_holes_and_parts_of_the_scene(tmp_path: Path) -> None:
    """The report is of the scene's mesh, welded and closed, or as in the file; and of springs between parts."""
    loose = quad_sphere(9)
    loose = replace(
        loose, points=loose.points[loose.face_vertex_indices][4:], face_vertex_counts=loose.face_vertex_counts[1:]
    )
    loose = replace(loose, face_vertex_indices=np.arange(len(loose.points), dtype=np.int32))
    mesh = joined(loose, replace(cube(), points=cube().points + 3.0))
    write_obj(tmp_path / "loose.obj", mesh)

    def report(*words: str) -> dict:
        result = command(tmp_path / "loose.obj", "--json", *words)
        assert result.returncode == 0
        return json.loads(result.stdout)

    whole = report()
    assert (whole["closed"], whole["components"], whole["faces"]) == (True, 2, 486 + 6)
    assert whole["in_file"]["components"] == 486
    assert whole["springs"]["holding"] > 6
    assert not report("--set", "balloon.holes=keep")["closed"]
    assert report("--set", "balloon.weld=false", "--set", "balloon.parts=free")["components"] == 486
    assert report("--set", "balloon.parts=free")["springs"]["holding"] == 0
