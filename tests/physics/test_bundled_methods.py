"""Claims of the paper about its methods, measured in bundled scenes; and the squirrel on its string: upright by
default, upside down as in the paper's figures."""

import numpy as np
import pytest
from played import played, shape_at, stretches
from scipy.spatial.transform import Rotation

from balloon_warp.mesh.topology import signed_volume


def test_with_correction_the_shape_is_a_scaled_copy():
    """The paper did not want that: at equal volume, without correction, the stretch varies twice as much."""
    strong = (
        *(("correction", "provot"), ("correction_limit", 0.25), ("frames", 110)),
        ("balloon.inflation.k_normal", ((0.2, 0.0), (1.7, 28.0))),
    )
    (model, plain), (_, corrected) = played("squirrel_inflate"), played("squirrel_inflate", strong)
    rest = signed_volume(shape_at(model, plain[0]))
    volumes = [signed_volume(shape_at(model, frames[-1])) for frames in (plain, corrected)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.1)
    spread = [np.ptp(np.percentile(stretches(model, frames[-1]), [10, 90])) for frames in (plain, corrected)]
    assert spread[1] < 0.5 * spread[0]
    assert volumes[1] == pytest.approx(1.25**3 * rest, rel=0.1)
    gentle = (("correction", "provot"), ("correction_limit", 0.1), ("frames", 120))  # the same inflation as without
    _, held = played("squirrel_inflate", gentle)
    assert signed_volume(shape_at(model, held[-1])) == pytest.approx(1.1**3 * rest, rel=0.05)
    assert np.ptp(np.percentile(stretches(model, held[-1]), [10, 90])) < 0.5 * spread[0]


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Return the root-mean-square distance of two shapes after alignment [m]."""
    first, second = (points.astype(np.float64) - points.mean(axis=0) for points in (first, second))
    return Rotation.align_vectors(second, first)[1] / len(first) ** 0.5


def test_stiff_springs_on_a_coarse_model_come_close_to_correction():
    """Springs twice as stiff leave less than half the distance to the corrected shape: the paper's squirrel."""
    stiff = tuple(
        (f"balloon.stiffness.{kind}", k) for kind, k in (("structural", 200), ("shear", 100), ("flexion", 10))
    )
    correction = (("correction", "provot"), ("correction_limit", 0.1))
    plain, stiffer, corrected = (
        played("squirrel_inflate", (*overrides, ("frames", 120)))[1][-1].points[0]
        for overrides in ((), stiff, correction)
    )
    assert apart(stiffer, corrected) < 0.5 * apart(plain, corrected)


def test_correction_constrains_a_strongly_inflated_balloon_most():
    volumes = {}
    for k_normal in (1.0, 14.0):
        inflation = (("frames", 110), ("balloon.inflation.k_normal", ((0.2, 0.0), (1.7, k_normal))))
        for correction in ("none", "provot"):
            model, frames = played("squirrel_inflate", (("correction", correction), *inflation))
            volumes[k_normal, correction] = signed_volume(shape_at(model, frames[-1]))
    assert volumes[1.0, "provot"] == pytest.approx(volumes[1.0, "none"], rel=0.01)
    assert volumes[14.0, "provot"] < 0.5 * volumes[14.0, "none"]


def test_tarantinos_correction_is_smoother_than_provots():
    """The paper says so: of the hundredth that changes its velocity the most from frame to frame, at the limit, the
    change is less, by 8% on the ground, by 9% in free air without gravity, by 14% on ice. A twentieth is asked. The
    balloon is larger by less than 2%, as springs pull less near their limit."""
    jolts, volumes = [], []
    for correction in ("provot", "tarantino"):
        held = (("correction", correction), ("correction_limit", 0.1), ("frames", 120))
        model, frames = played("squirrel_inflate", held)
        velocities = np.array([frame.velocities[0] for frame in frames[60:]])
        changes = np.linalg.norm(np.diff(velocities, axis=0), axis=-1)
        jolts.append(np.percentile(changes, 99, axis=1).mean())
        volumes.append(signed_volume(shape_at(model, frames[-1])))
    assert jolts[1] < 0.95 * jolts[0]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.02)


def test_cached_normals_give_the_shape_of_fresh_ones():
    """The paper says so. In the last half second volumes agree to three thousandths: those with cached normals jitter,
    and of seven starts a micrometer apart their means were 162.55 to 162.80 liters, where with fresh ones they were
    162.75 to 162.78."""
    model, fresh = played("squirrel_inflate")
    _, cached = played("squirrel_inflate", (("normals", "cached"),))
    volume = [np.mean([frame.volumes[0] for frame in frames[-30:]]) for frames in (fresh, cached)]
    np.testing.assert_allclose(volume[1], volume[0], rtol=3e-3)
    springs = model.shapes[0].springs
    lengths = [
        np.linalg.norm(np.diff(frames[-1].points[0][springs.pairs], axis=1), axis=-1).ravel()
        for frames in (fresh, cached)
    ]
    assert abs(lengths[1] / lengths[0] - 1.0).mean() < 0.01
    assert (lengths[0] / springs.rest_lengths).mean() > 1.1


def turned_by(rest: np.ndarray, points: np.ndarray, up: tuple[float, float, float]) -> float:
    """Return the angle [degrees] by which the best-fitting rotation turns the up axis."""
    rotation = Rotation.align_vectors(points - points.mean(axis=0), rest - rest.mean(axis=0))[0]
    return float(np.degrees(np.arccos(np.clip(rotation.apply(up) @ up, -1.0, 1.0))))


def test_squirrel_tether_floats_upright_and_still_above_its_anchor():
    """The string is at its length at the start, and straight at the end, stretched by the lift; after five seconds
    nothing moves by more than some millimeters a second."""
    model, frames = played("squirrel_tether")
    string, balloon, end = model.scene.string[0], model.scene.balloon[0], frames[-1]
    points = end.points[0].astype(np.float64)
    assert turned_by(model.shapes[0].mesh.points, points, model.scene.up) < 5.0
    np.testing.assert_allclose(points.mean(axis=0)[[0, 2]], 0.0, atol=0.01)
    assert np.linalg.norm(end.velocities[0], axis=1).max() < 0.005
    length = float(model.parameters["string_length"].numpy()[0, 0])
    held = model.string_particle.numpy()[0]
    reach = [float(np.linalg.norm(frame.points[0][held] - string.anchor)) for frame in (frames[0], end)]
    assert reach[0] == pytest.approx(length, rel=1e-6)
    lift = balloon.mass * (balloon.helium - model.scene.gravity)
    assert reach[1] - length == pytest.approx(lift / string.stiffness, rel=0.01)
    rest = model.shapes[0].mesh
    assert signed_volume(shape_at(model, end)) > 1.5 * signed_volume(rest)


PAPERS_TETHER = (
    ("balloon.inflation.k_normal", ((0.0, 2.0), (1.0, 8.0))),
    ("balloon.stiffness.thin", "alike"),
    ("string.anchor", (-0.3, 0.6, 0.0)),
    ("string.particle", "highest"),
    ("string.length", 1.0),
)
"""the paper's inflation, and the string at the very end of the tail"""


def test_squirrel_tether_turns_from_upright_to_upside_down():
    """The squirrel turns over in the frames of figures 19 to 21, and hangs so to the end, above a taut string."""
    model, frames = played("squirrel_tether", PAPERS_TETHER)
    places = [frames[number].points[0].astype(np.float64) for number in (0, 80, 300, -1)]
    turned = [turned_by(model.shapes[0].mesh.points, each, model.scene.up) for each in places]
    assert turned[0] < 1.0
    assert 45.0 < turned[1] < 100.0
    assert min(turned[2:]) > 120.0
    string, points = model.scene.string[0], places[-1]
    held = points[model.string_particle.numpy()[0]]
    assert string.length is not None
    assert np.linalg.norm(held - string.anchor) > string.length
    assert held[1] < points[:, 1].min() + 0.1
    assert points[:, 1].mean() > held[1] + 0.5
