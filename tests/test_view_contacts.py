"""Arrows of contact forces in the page, without a browser."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp.scene import Balloon, Ground, Inflation, Scene

pytest.importorskip("viser")

from balloon_warp.viewer.presses import LONGEST, PressLayer
from balloon_warp.viewer.session import Session


def lying(**fields) -> Scene:
    """Return a ball that lies on the ground, where it was put."""
    inflation = Inflation(kind="pressure", pressure=15.0)
    balloon = Balloon(mesh=quad_sphere(3, 0.5), position=(0, 0.49, 0), mass=0.3, damping=4.0, inflation=inflation)
    return Scene(balloon=[balloon], ground=Ground(), **fields)


def test_an_arrow_for_each_pair_says_how_hard_it_presses():
    """An arrow starts where the ball is pressed and points along the force; the strongest has the largest length."""
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
    """The strongest force of the last pictures is the scale, which decays."""
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
