"""Images on balloons in the page, without a browser."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import cube
from PIL import Image

pytest.importorskip("viser")

from balloon_warp.viewer.prints import LARGEST, Printed, image_of
from balloon_warp.viewer.smooth import Plain, Smooth


@pytest.mark.parametrize("kind", [Plain, Smooth])
def test_a_print_is_where_its_coordinates_say(kind: type[Plain] | type[Smooth]):
    """A print is cut where its halves meet: each face of a cube shows the left or the right half of an image. The
    triangles cover as much of it as the faces do, and both sides of a cut coincide."""
    mesh = cube()
    ends = np.repeat(np.arange(6) % 2 * 0.5, 4)
    corners = np.tile([(0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.0, 1.0)], (6, 1)) + np.stack([ends, 0 * ends], axis=1)
    whole = kind(mesh)
    cut = Printed(whole, replace(mesh, texture_coordinates=corners))
    points = mesh.points.astype(np.float32)
    np.testing.assert_array_equal(cut.points(points)[cut.triangles], whole.points(points)[whole.triangles])
    a, b, c = (cut.places[cut.triangles[:, n], :2].astype(float) for n in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    np.testing.assert_allclose(np.bincount(cut.triangle_faces, areas), 0.5, rtol=1e-6)
    twins = cut.places[:, 2].astype(int)
    np.testing.assert_array_equal(cut.points(points)[twins], cut.points(points))
    assert len(np.unique(twins)) == len(whole.points(points)) < len(twins)


def test_an_image_is_made_small_enough_and_none_is_made_of_what_is_none(tmp_path):
    Image.new("RGBA", (2 * LARGEST, LARGEST), (10, 20, 30, 40)).save(tmp_path / "large.png")
    image = image_of(tmp_path / "large.png")
    assert image is not None
    assert image.shape == (LARGEST // 2, LARGEST, 3)
    (tmp_path / "text.png").write_text("no image", encoding="utf-8")
    assert image_of(tmp_path / "text.png") is None
    assert image_of(None) is None
