"""Page after a blow-up, without a browser."""

import numpy as np
import pytest
from browsing import wait_until
from meshes import quad_sphere

from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.viewer.session import Session


@pytest.mark.parametrize(
    ("material", "inflation", "sentence"),
    [
        (Material(), Inflation(kind="pressure", pressure=1e5), "Too much pressure for these springs."),
        (Material(preset="latex"), Inflation(kind="pressure", pressure=1e7), "Too much pressure for this skin."),
        (Material(), Inflation(k_normal=1e8), "Too much pressure for these springs."),
    ],
)
def test_a_blow_up_says_what_was_too_much_and_leaves_the_last_good_shape(tmp_path, material, inflation, sentence):
    """A blow-up names the cause and keeps the last good shape, from which the page continues after going back."""
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
