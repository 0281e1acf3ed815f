"""Quads of membranes begin elsewhere, and particles read in another order, but the same, in fewer wavefronts."""

import numpy as np
from meshes import quad_sphere

from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Material, Scene
from balloon_warp.schedules.banks import wavefronts
from balloon_warp.schedules.film_banks import QUARTER_WARP, spread_places, turned_quads
from balloon_warp.schedules.membranes import membrane_quads

MODEL = build_model(Scene(balloon=[Balloon(mesh=quad_sphere(9, 0.1), material=Material(preset="latex"))]), "cpu")


def test_turned_quads_are_the_same() -> None:
    quads = membrane_quads(MODEL)
    turned = turned_quads(quads, MODEL.particle_count)
    turns = (turned.corners[:, :1] == quads.corners).argmax(axis=1)
    assert turns.any()
    for face, turn in enumerate(turns.tolist()):
        for name in ("corners", "rests", "numbers"):
            begun = np.roll(getattr(quads, name)[face], -turn, axis=0)
            np.testing.assert_array_equal(begun, getattr(turned, name)[face])
    before, after = (wavefronts(np.pad(each.corners.T, ((0, 0), (0, 2)))) for each in (quads, turned))
    assert after < 0.7 * before


def test_spread_places_are_the_same() -> None:
    rng = np.random.default_rng(0)
    places = np.stack([rng.permutation(512) for _ in range(4)])[:, :488]
    places[3, ::50] = -1
    spread = spread_places(places)
    np.testing.assert_array_equal(np.sort(spread, axis=0), np.sort(places, axis=0))
    assert fullest(spread) < 0.9 * fullest(places)


def fullest(places: np.ndarray) -> float:
    """Wavefronts that a quarter of a warp takes for a load of four words, on average."""
    loads = places.reshape(len(places), -1, QUARTER_WARP)
    banks = np.where(loads < 0, -1, loads % QUARTER_WARP)
    return float(np.mean([np.bincount(each[each >= 0]).max() for each in banks.reshape(-1, QUARTER_WARP)]))
