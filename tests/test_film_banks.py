"""Quads of membranes begin elsewhere, and particles read in another order, but the same, in fewer wavefronts."""

import numpy as np
from meshes import quad_sphere

from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Material, Scene
from balloon_warp.schedules.banks import wavefronts
from balloon_warp.schedules.film_banks import QUARTER_WARP, spread_places, turned_quads
from balloon_warp.schedules.membranes import membrane_quads
from balloon_warp.schedules.pair_banks import EXCHANGED, corners_of_pairs, quads_in_pairs, quads_of_pairs
from balloon_warp.schedules.pair_ends import dealt_ends, pairs_around, seats
from balloon_warp.schedules.pairs import paired, shared_edges

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


def test_dealt_pairs_are_the_same() -> None:
    quads = membrane_quads(MODEL)
    pairs = paired(quads.corners, quads.balloons)
    paired_quads, dealt_quads = (each(quads, pairs) for each in (quads_of_pairs, quads_in_pairs))
    one, other = (corners_of_pairs(each) for each in (paired_quads, dealt_quads))
    exchanged = one[:, EXCHANGED]
    same = (other[:, None] == one).all(axis=2)
    back = (other[:, None] == exchanged).all(axis=2)
    assert same.any()
    assert back.any()
    assert ((same | back).sum(axis=0) == 1).all()
    assert ((same | back).sum(axis=1) == 1).all()
    rests = {tuple(corners): rest for corners, rest in zip(quads.corners.tolist(), quads.rests, strict=True)}
    for corners, rest in zip(dealt_quads.corners.tolist(), dealt_quads.rests, strict=True):
        turns = [turn for turn in range(4) if tuple(corners[turn:] + corners[:turn]) in rests]
        np.testing.assert_array_equal(np.roll(rest, -turns[0], axis=0), rests[tuple(np.roll(corners, -turns[0]))])
    before, after = (wavefronts(np.pad(each.T, ((0, 0), (0, 488 - 243)), mode="edge")) for each in (one, other))
    assert after < 0.9 * before
    quarters_before, quarters_after = (fullest(in_classes(each, MODEL.particle_count)) for each in (one, other))
    assert quarters_after < 0.95 * quarters_before


def test_threads_have_the_ends_of_their_pairs() -> None:
    quads = membrane_quads(MODEL)
    corners = corners_of_pairs(quads_of_pairs(quads, paired(quads.corners, quads.balloons)))
    count, threads = MODEL.particle_count, 256
    dealt = dealt_ends(corners, np.array([count, threads]))
    np.testing.assert_array_equal(np.sort(dealt[:, 0]), np.arange(len(corners)))
    turned = np.where(dealt[:, 1:] > 0, corners[dealt[:, 0]][:, EXCHANGED], corners[dealt[:, 0]])
    places = seats(turned, np.array([count, threads]))
    np.testing.assert_array_equal(np.sort(places), np.arange(count))
    np.testing.assert_array_equal(places[: len(corners)], turned[:, 1])
    np.testing.assert_array_equal(places[threads:], turned[: count - threads, 2])


def test_each_particle_is_at_an_edge_of_two_quads() -> None:
    """But for one beside all, of which none is told."""
    corners = membrane_quads(MODEL).corners
    particles = np.arange(MODEL.particle_count + 1)
    around = pairs_around(corners, shared_edges(corners, np.zeros(len(corners), dtype=np.int64)), particles)
    np.testing.assert_array_equal(around[-1], -1)
    first, second = (
        np.take_along_axis(corners[around[:-1, n]], (np.arange(4) + around[:-1, n + 2, None]) % 4, axis=1)
        for n in (0, 1)
    )
    np.testing.assert_array_equal(first[:, 1], particles[:-1])
    np.testing.assert_array_equal(first[:, 1:3], second[:, [0, 3]])


def test_too_few_threads_have_no_ends() -> None:
    """Or so many that each particle has its own."""
    quads = membrane_quads(MODEL)
    corners = corners_of_pairs(quads_of_pairs(quads, paired(quads.corners, quads.balloons)))
    for threads in (len(corners) - 1, len(corners), MODEL.particle_count):
        assert len(dealt_ends(corners, np.array([MODEL.particle_count, threads]))) == 0


def in_classes(corners: np.ndarray, particle_count: int) -> np.ndarray:
    """Which pairs' threads each particle looks at, in the order that was found, -1 where there are no more."""
    pair, corner = np.divmod(np.arange(corners.size), corners.shape[1])
    order = np.argsort(corners[pair, corner], kind="stable")
    particles, threads = corners[pair, corner][order], pair[order]
    counts = np.bincount(particles, minlength=particle_count)
    places = np.full((counts.max(), particle_count), -1)
    places[np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts), particles] = threads
    return spread_places(places)


def fullest(places: np.ndarray) -> float:
    """Wavefronts that a quarter of a warp takes for a load of four words, on average."""
    loads = places.reshape(len(places), -1, QUARTER_WARP)
    banks = np.where(loads < 0, -1, loads % QUARTER_WARP)
    return float(np.mean([np.bincount(each[each >= 0]).max() for each in banks.reshape(-1, QUARTER_WARP)]))
