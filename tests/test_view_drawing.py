"""Page without a browser: arrows of contact forces, images on balloons, and what a blow-up says."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from meshes import cube, quad_sphere
from PIL import Image
from strangers import wait_until

from balloon_warp.scene import Balloon, Ground, Inflation, Material, Scene
from balloon_warp.viewer.presses import LONGEST, PressLayer
from balloon_warp.viewer.prints import LARGEST, Printed, image_of
from balloon_warp.viewer.session import Session
from balloon_warp.viewer.smooth import Plain, Smooth


def lying(**fields) -> Scene:
    """Return a ball that lies on the ground, where it was put."""
    inflation = Inflation(kind="pressure", pressure=15.0)
    balloon = Balloon(mesh=quad_sphere(3, 0.5), position=(0, 0.49, 0), mass=0.3, damping=4.0, inflation=inflation)
    return Scene(balloon=[balloon], ground=Ground(), **fields)


def test_an_arrow_for_each_pair_says_how_hard_it_presses():
    session = Session("ball", lying(contacts=True), "cpu")
    for _ in range(30):
        session.playground.step()
    layer = PressLayer(MagicMock(), size=1.0)
    picture = session._take_picture()
    (arrow,), (contact,) = layer.arrows_of(picture), picture.frame.contacts
    np.testing.assert_allclose(arrow[0], contact.place, atol=1e-6)
    along = contact.force / np.linalg.norm(contact.force)
    np.testing.assert_allclose(arrow[1] - arrow[0], LONGEST * along, atol=1e-6)
    assert along[1] > 0.99
    assert abs(arrow[0][1]) < 0.05


def test_a_blow_does_not_dwarf_for_long_what_follows():
    layer = PressLayer(MagicMock(), size=1.0)

    def length(force: float) -> float:
        contact = SimpleNamespace(force=np.array([0.0, force, 0.0]), place=np.zeros(3))
        picture: Any = SimpleNamespace(frame=SimpleNamespace(contacts=[contact]))
        arrows = layer.arrows_of(picture)
        return float(np.ptp(arrows[:, :, 1])) if len(arrows) else 0.0

    assert length(100.0) == pytest.approx(LONGEST)
    assert length(10.0) < 0.2 * LONGEST
    assert [length(10.0) for _ in range(300)][-1] == pytest.approx(LONGEST)
    assert length(0.0) == 0.0


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


@pytest.mark.full
@pytest.mark.parametrize(
    ("material", "inflation", "sentence"),
    [
        (Material(), Inflation(kind="pressure", pressure=1e5), "Too much pressure for these springs."),
        (Material(preset="latex"), Inflation(kind="pressure", pressure=1e7), "Too much pressure for this skin."),
        (Material(), Inflation(k_normal=1e8), "Too much pressure for these springs."),
    ],
)
def test_a_blow_up_says_what_was_too_much_and_leaves_the_last_good_shape(tmp_path, material, inflation, sentence):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.5), material=material, inflation=inflation)])
    session = Session("ball", scene, "cpu", tmp_path)
    session.watched = True
    session.start()
    wait_until(lambda: session.picture.trouble, "it blows up")
    assert session.picture.trouble == sentence
    assert session.picture.why.startswith("the simulation blew up in frame")
    assert np.abs(session.picture.frame.points[0]).max() < 5.0
    session.go_back()
    wait_until(lambda: not session.picture.trouble, "it goes back")
    session.ask(lambda playground: playground.inflate(0.01))
    frame = session.picture.frame.number
    session.run(True)
    wait_until(lambda: session.picture.frame.number > frame + 3, "it goes on")
    session.stop()
