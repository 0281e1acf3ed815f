"""Handles of a remeshed surface: those of the source, or a sentence gives the reason."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import joined
from numpy.typing import NDArray
from quads import assert_closed_quads

from balloon_warp import InputError, PolygonMesh, remesh
from balloon_warp.mesh.surface_nets import Level, surface_nets
from balloon_warp.tools.remesh import handle_count, handles_lost, handles_of_level


def statue(hole: float, handle: float = 0.08) -> PolygonMesh:
    """Return a flat body with a hole of that radius through it, and a round handle on its side: genus 2."""

    def distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = points.T
        body = 0.3 * (np.sqrt(x**2 + (y / 0.7) ** 2 + (z / 0.3) ** 2) - 1.0)
        ring = np.hypot(np.hypot(x - 1.0, y) - 0.3, z) - handle
        return np.minimum(np.maximum(body, hole - np.hypot(x + 0.3, y)), ring)

    return surface_nets(distance, [-1.1, -0.8, -0.4], [1.5, 0.8, 0.4], cell=min(0.05, 0.6 * hole))


@pytest.fixture(scope="module")
def narrow() -> PolygonMesh:
    """Return a statue whose hole takes some 30 cells."""
    return statue(0.05)


@pytest.mark.parametrize("cells", [16, 24, 40, 64])
def test_a_clean_statue_of_genus_2_keeps_its_handles(narrow: PolygonMesh, cells: int) -> None:
    assert handle_count(narrow) == 2
    made = remesh(narrow, cells)
    assert_closed_quads(made, holes_through=2)
    more = [warning for warning in made.warnings if "were used" in warning]
    assert len(more) == (cells < 30)
    if more:
        assert more[0].startswith(f"With {cells} cells 1 of its 2 handles, or holes through it, is lost: ")


def test_a_number_that_one_has_to_ask_for_is_named(narrow: PolygonMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("balloon_warp.tools.remesh.MOST_BY_ITSELF", 0)
    with pytest.raises(InputError) as refused:
        remesh(narrow, 24)
    said = str(refused.value)
    assert said.startswith("mesh: with 24 cells 1 of its 2 handles, or holes through it, is lost; expected --cells ")
    cells = int(said.split("--cells ")[1].split(",")[0])
    assert_closed_quads(remesh(narrow, cells), holes_through=2)


def test_a_hole_that_no_cells_keep_is_closed_and_that_is_said(narrow: PolygonMesh, monkeypatch) -> None:
    """Handles of a scan, whose surface came too near to itself. The ring on the side is a cell thick: fitted whole
    its quads cross each other in 108 places, so a part stays thick."""
    monkeypatch.setattr("balloon_warp.tools.remesh.MAX_CELLS", 24)
    made = remesh(narrow, 16)
    assert_closed_quads(made, holes_through=1)
    assert made.warnings == (
        "Open parts became 1.5 cells thick (0.223), as did thin parts without room; more cells make them thinner.",
        "With 16 cells 1 of its 2 handles, or holes through it, is lost: no number of cells keeps the handles.",
    )


@pytest.mark.parametrize("cells", [12, 24, 50])
def test_handles_are_counted_as_surface_nets_have_them(narrow: PolygonMesh, cells: int) -> None:
    level = Level.of(narrow, cells)
    nets = surface_nets(level.distance, -level.reach, level.reach, cell=1.0)
    assert handles_of_level(level.distance, level.reach) == handle_count(nets)


def test_where_parts_cross_handles_say_nothing(narrow: PolygonMesh) -> None:
    """Handles are not counted where parts cross: a ball in the hole, as one part with the statue or with another."""
    wide = statue(0.25)
    assert handles_lost(wide, narrow) == 0
    ball = surface_nets(lambda p: np.linalg.norm(p + [0.3, 0.0, 0.0], axis=1) - 0.28, [-0.6] * 3, [0.6] * 3, 0.05)
    plugged = joined(wide, ball)
    assert handles_lost(plugged, joined(ball, ball)) is None
    assert handles_lost(wide, ball) == 2
    assert handles_lost(ball, wide) == -2
    open_ball = replace(ball, face_vertex_counts=ball.face_vertex_counts[1:])
    open_ball = replace(open_ball, face_vertex_indices=ball.face_vertex_indices[4:])
    assert handles_lost(open_ball, ball) is None
    made = remesh(plugged, 24)
    assert_closed_quads(made, holes_through=1)
