"""Octets of quads that have no corner in common."""

import numpy as np
import pytest
from meshes import quad_sphere
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.schedules.octets_apart import LANES, octets_apart


def quads_of(mesh: PolygonMesh) -> NDArray[np.int64]:
    return np.asarray(mesh.face_vertex_indices, dtype=np.int64).reshape(-1, 4)


def fan(count: int) -> NDArray[np.int64]:
    """Return triangles around a tip, the first corner again as the third."""
    rim = 1 + np.arange(count)
    return np.column_stack([np.zeros(count, dtype=np.int64), rim, np.zeros(count, dtype=np.int64), np.roll(rim, -1)])


ITEMS: dict[str, tuple[NDArray[np.int64], int]] = {
    "a cube, of which two faces are apart": (quads_of(quad_sphere(1)), 3),
    "a ball": (quads_of(quad_sphere(9)), -(-6 * 81 // LANES)),
    "a cone, whose triangles all meet": (fan(40), 40),
    "a cone on a ball": (np.concatenate([quads_of(quad_sphere(9)) + 41, fan(40)]), -(-(6 * 81 + 40) // LANES)),
    "one": (fan(1), 1),
}
"""Corners of items, and the octets that they need"""


@pytest.mark.parametrize("case", ITEMS)
def test_no_two_of_an_octet_share_a_corner(case: str):
    """Each has a place of its own, no octet is empty, and there are no more than it takes."""
    corners, octets = ITEMS[case]
    places = octets_apart(corners)
    assert len(np.unique(places)) == len(corners)
    assert np.unique(places // LANES).tolist() == list(range(octets))
    for octet in range(octets):
        inside = [set(each) for each in corners[places // LANES == octet].tolist()]
        assert sum(map(len, inside)) == len(set().union(*inside))


def test_any_corners_will_do():
    """Items of random corners among few are apart, too."""
    draw = np.random.default_rng(3)
    for count, among in ((6, 8), (100, 40), (900, 300)):
        corners = np.array([draw.choice(among, 4, replace=False) for _ in range(count)])
        places = octets_apart(corners)
        entries = np.column_stack([np.repeat(places // LANES, 4), corners.ravel()])
        assert len(np.unique(entries, axis=0)) == 4 * count
        assert len(np.unique(places)) == count
