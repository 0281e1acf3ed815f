"""Page without a browser: its address, its view distance, its drawings, and its refusals."""

import re
import socket
import sys
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
import trimesh
from meshes import cube, quad_sphere
from PIL import Image
from strangers import page_of, wait_until
from typer.testing import CliRunner

from balloon_warp import InputError, MissingExtraError, Simulator, show
from balloon_warp.cli.app import app
from balloon_warp.model import build_model
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.scene import Atmosphere, Balloon, Change, Ground, Inflation, Material, Obstacle, Scene, String
from balloon_warp.studio.page.controls import COMPILING, VALUES, does_something, of_tables, span, span_of, status_line
from balloon_warp.studio.page.drawings import Plain, Smooth, string_reach
from balloon_warp.studio.page.layers import LARGEST, LONGEST, PressLayer, Printed, image_of, surface_of
from balloon_warp.studio.page.page import Page
from balloon_warp.studio.page.playground import REASON, Kinds, Touch
from balloon_warp.studio.page.session import LOOKING, Session


def served(tmp_path: Path) -> Page:
    return page_of(Scene(balloon=[Balloon(mesh=quad_sphere(3))]), tmp_path)


@pytest.mark.full
@pytest.mark.parametrize(
    ("host", "place"),
    [("0.0.0.0", "127.0.0.1"), ("::", "[::1]"), ("here.example", "here.example")],
)
def test_the_page_says_where_it_is(host, place, tmp_path, monkeypatch):
    page = served(tmp_path)
    monkeypatch.setattr(page.server, "get_host", lambda: host)
    assert page.address == f"http://{place}:{page.server.get_port()}"
    page.stop()


@pytest.mark.full
def test_the_page_is_on_loopback_alone_and_refuses_a_taken_port(tmp_path):
    page = served(tmp_path)
    assert page.server.get_host() == "127.0.0.1"
    assert page.server.request_share_url() is None
    page.stop()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = CliRunner().invoke(app, ["view", "squirrel_inflate", "--port", str(port)])
    assert str(result.exception) == f"--port {port}: cannot listen on 127.0.0.1: Address already in use"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["no_such_scene"], "no_such_scene: no such scene or file"),
        (["squirrel_inflate", "-o", "no/such/folder"], "no/such/folder: the folder does not exist"),
        (["squirrel_inflate", "--host", "203.0.113.7"], "--host 203.0.113.7: cannot listen on 203.0.113.7"),
    ],
)
def test_mistakes_are_refused_in_a_sentence(arguments, sentence):
    result = CliRunner().invoke(app, ["view", *arguments])
    assert isinstance(result.exception, InputError)
    assert str(result.exception).startswith(sentence)


def test_the_page_sees_as_far_as_a_string_lets_a_balloon_come():
    up = np.array([0.0, 1.0, 0.0])
    for height, far in ((0.5, 1.5 + 2.0), (-0.5, -1.5 - 2.0)):
        balloon = Balloon(mesh=quad_sphere(2), position=(0.0, height, 0.0))
        model = build_model(Scene(balloon=[balloon], string=[String(anchor=(1.0, 0.0, 0.0), length=1.5)]), "cpu")
        reach = string_reach(model, up)
        np.testing.assert_allclose(reach, [[1.0, 0.0, 0.0], [1.0, far, 0.0]])
    without = build_model(Scene(balloon=[Balloon(mesh=quad_sphere(2))]), "cpu")
    assert string_reach(without, up).shape == (0, 3)


def test_a_slider_and_a_plot_end_at_values_that_one_can_read():
    """A slider at two digits; a plot where its five ticks differ."""
    for most, end in ((13.743272, 14.0), (0.0123, 0.013), (995.0, 1000.0), (0.3, 0.3)):
        slider = SimpleNamespace()
        span(slider, most, signed=True)
        assert (slider.min, slider.max, slider.step) == (-end, end, pytest.approx(end / 500))
    for curve in ([0.0, 0.0], [174.01, 174.02], [1.0, 1.0001], [-5.0, 1.0]):
        low, high = span_of(np.array(curve))
        assert low <= min(curve) <= max(curve) <= high
        assert len({f"{tick:.3f}" for tick in np.linspace(low, high, 5)}) == 5


def shown(scene: Scene) -> dict[str, list[str]]:
    """Return the sliders of a scene, beside those that every scene has."""
    return {
        name: [value.row.name for value in values if does_something(scene, value.row)]
        for name, values in of_tables().items()
    }


def test_contacts_materials_air_and_gas_have_sliders_where_a_scene_has_them():
    plain = shown(Scene(balloon=[Balloon(mesh=quad_sphere(2))]))
    assert plain["Contacts"] == plain["Material"] == plain["Gas"] == []
    latex = Balloon(mesh=quad_sphere(2), material=Material(preset="latex"), inflation=Inflation(kind="gas"))
    around = {"ground": Ground(), "water": {}, "atmosphere": Atmosphere(wind=(1.0, 0.0, 0.0))}
    touching = shown(Scene(balloon=[latex], touch={"stiffness": 3.0}, **around))
    of_ground = {"ground_height", "ground_friction", "ground_restitution"}
    assert set(touching["Contacts"]) == of_ground | {
        "touch_friction",
        "touch_stiffness",
    }  # no thickness: it is left to us
    assert set(touching["Material"]) == {"thickness", "shear_modulus", "mooney_ratio", "film_viscosity"}
    assert {"leak", "gamma"} <= set(touching["Gas"])
    assert {"water_density", "wind_shear", "gusts"} <= set(touching["Air and water"])
    assert not {"fill_breaths", "molar_mass"} & set(touching["Gas"])


def test_what_does_nothing_as_things_are_has_no_slider():
    def springs(material: Material) -> list[str]:
        scene = Scene(balloon=[Balloon(mesh=quad_sphere(2), material=material)])
        rows = [value.row for value in VALUES if does_something(scene, value.row)]
        return [row.name for row in rows if row.name in ("structural", "shear", "flexion")]

    assert springs(Material()) == ["structural", "shear", "flexion"]
    assert springs(Material(preset="latex")) == []
    assert springs(Material(preset="latex", springs=["flexion"])) == ["flexion"]
    plain = Balloon(mesh=quad_sphere(2))
    assert not {"gusts", "air_pressure"} & set(shown(Scene(balloon=[plain]))["Air and water"])
    dragged = plain.model_copy(update={"drag_coefficient": 0.5})
    assert "air_pressure" in shown(Scene(balloon=[dragged]))["Air and water"]
    wind = Scene(balloon=[dragged], atmosphere=Atmosphere(wind=(1.0, 0.0, 0.0)))
    assert "gusts" in shown(wind)["Air and water"]
    assert "gust_length" not in shown(wind)["Air and water"]


def test_a_simulator_shows_the_page_until_it_is_closed(tmp_path):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=quad_sphere(3))]), "cpu")
    simulator.step()
    shown = show(simulator, folder=tmp_path, height=500)
    assert f'<iframe src="{shown.address}"' in shown._repr_html_()
    assert "height: 500px" in shown._repr_html_()
    with urllib.request.urlopen(shown.address, timeout=60) as answer:
        assert "localhost:*" in answer.headers["Content-Security-Policy"]
        page = answer.read()
    assert b"bw-keys" in page
    assert page.index(b"charset") < 1024  # or browsers do not look for it
    shown.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(shown.address, timeout=60)
    assert simulator.frame_number == 1


def test_the_page_begins_where_a_simulator_is(tmp_path):
    helium = Balloon(mesh=quad_sphere(3), helium=5.0)
    scene = Scene(balloon=[helium], change=[Change(time=2.0 / 60.0, set={"balloon.0.helium": 50.0})])
    simulator = Simulator(scene, "cpu", world_count=2)
    points = simulator.state.points.numpy()
    points[1] += 1.0
    simulator.state.points.assign(points)
    for _ in range(4):
        simulator.step()
    with pytest.raises(InputError, match="world: no world 2; expected 0 to 1"):
        show(simulator, 2, folder=tmp_path)
    shown = show(simulator, 1, folder=tmp_path)
    session = shown.page.session  # time stands still, as nobody looks
    assert (session.picture.frame.number, session.playground.frame) == (4, 4)
    np.testing.assert_array_equal(session.playground.points, simulator.state.points.numpy()[1])
    shown.close()
    simulator.step()
    session.playground.step()
    # Other kernels run two worlds than one: within float32's rounding.
    np.testing.assert_allclose(session.playground.points, simulator.state.points.numpy()[1], atol=1e-5)
    session.playground.reset()
    assert session.playground.frame == 0


def test_showing_without_the_extra_is_refused_in_a_sentence(monkeypatch):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=quad_sphere(3))]), "cpu")
    monkeypatch.delitem(sys.modules, "balloon_warp.studio.page.page", raising=False)
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingExtraError, match=r"^view needs viser: pip install 'balloon-warp\[view\]'$"):
        show(simulator)


def test_the_line_of_status_says_how_fast_time_runs_and_why():
    picture = Session("ball", Scene(balloon=[Balloon(mesh=quad_sphere(2))]), "cpu").picture

    def said(busy: float = 0.0, **how) -> tuple[str, str]:
        now = replace(picture, **{"running": True, "speed": 1.0, "rate": 1.0, "seconds": 2.0} | how)
        line = status_line(now, busy)
        found = re.fullmatch(r'<div class="bw-status"[^>]* title="(.*)"><span>(.*)</span></div>', line)
        assert found
        return found[2], found[1]

    assert said() == ("<b>2.00 s</b> · real time", "")
    assert said(running=False) == ("<b>2.00 s</b> · paused", "")
    assert said(busy=1.26) == ("<b>2.00 s</b> · getting ready: 1.3 s", COMPILING)
    assert said(recorded_seconds=1.5)[0].endswith(" · ● 1.5 s")
    assert said(speed=0.5, rate=0.49) == ("<b>2.00 s</b> · 0.49x real time", "")
    slow, why = said(rate=0.5, step_seconds=2.0 / 60.0)
    assert (slow, why) == (
        "<b>2.00 s</b> · 0.50x real time",
        "slower than requested: a frame takes 33 ms, and one is due every 17 ms",
    )
    assert said(rate=0.5, step_seconds=0.006)[1].endswith("this machine is busy; simulating a frame takes 6 ms")


UPS = {"Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def shapes(up_axis: str) -> list[ObstacleShape]:
    obstacles = [
        Obstacle(size=(1.0, 2.0, 3.0), position=(0.0, -9.0, 0.0)),
        Obstacle(radius=0.2, length=0.6, position=(3.0, 0.0, 0.0)),
        Obstacle(shape="plane", position=(0.0, -2.0, -2.0)),
        Obstacle(mesh=cube(), position=(-3.0, 0.0, 0.0)),
    ]
    scene = Scene(up_axis=up_axis, balloon=[Balloon(mesh=quad_sphere(3))], obstacle=obstacles)
    return build_model(scene, "cpu").obstacles


@pytest.mark.parametrize("up_axis", UPS)
def test_what_is_drawn_has_their_shapes(up_axis: str):
    up = np.array(UPS[up_axis])
    box, capsule, plane, mesh = shapes(up_axis)
    below = np.array([0.5, 4.0, 7.0])
    drawn = [trimesh.Trimesh(*surface_of(shape, UPS[up_axis], below, 10.0)) for shape in (box, capsule, plane, mesh)]
    volumes = [drawn[solid].volume for solid in (0, 1, 3)]
    np.testing.assert_allclose(volumes, [6.0, np.pi * 0.2**2 * (0.6 + 4 / 3 * 0.2), 1.0], rtol=0.01)
    np.testing.assert_allclose(np.ptp(drawn[0].bounds, axis=0), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(drawn[1].bounds, np.outer([-1.0, 1.0], 0.2 + 0.3 * up), atol=1e-9)
    np.testing.assert_allclose(drawn[2].face_normals, [up, up], atol=1e-9)
    np.testing.assert_allclose(drawn[2].bounds.mean(axis=0), below - (below @ up) * up, atol=1e-9)


def test_the_page_moves_what_moves(tmp_path: Path):
    obstacles = [
        Obstacle(position=(0.0, -3.0, 0.0), color=(1.0, 0.0, 0.0)),
        Obstacle(shape="capsule", position=(3.0, 0.0, 0.0), motion=[(0.0, (0, 0, 0)), (1.0, (0, 1, 0), (90, 0, 0))]),
    ]
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3))], obstacle=obstacles)
    page = page_of(scene, tmp_path)
    picture = page.session.picture
    page.layers.draw(picture)
    box, capsule = page.layers.obstacles._meshes
    assert (tuple(box.position), tuple(box.color)) == ((0.0, -3.0, 0.0), (255, 0, 0))
    later = picture.frame.obstacle_poses.copy()
    later[1] = (3.0, 1.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    page.layers.draw(replace(picture, frame=replace(picture.frame, obstacle_poses=later)))
    np.testing.assert_allclose(capsule.position, (3.0, 1.0, 0.0))
    np.testing.assert_allclose(capsule.wxyz, np.sqrt([0.5, 0.5, 0.0, 0.0]))
    assert tuple(box.position) == (0.0, -3.0, 0.0)
    above = np.array([[0.2, 5.0, 0.0], [3.0, 5.0, 0.0], [9.0, 5.0, 0.0]])
    hits = [page.layers.obstacles.hit_distance(place, np.array([0.0, -1.0, 0.0])) for place in above]
    assert hits == [pytest.approx(7.5), pytest.approx(5.0 - 1.1, abs=1e-3), None]  # the capsule lies now
    ball = quad_sphere(3).points
    expected = [(ball[:, 0].min() + 3.1) / 2, (ball[:, 1].max() - 3.5) / 2, 0.0]  # from ball to capsule and to box
    np.testing.assert_allclose(page.layers.home[1], expected, atol=0.01)
    page.stop()


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


def test_a_touch_waits_for_its_kernels_and_time_does_not_wait_for_it(tmp_path):
    session = Session("ball", Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.5))]), "cpu", tmp_path)
    ready: set[Kinds] = {frozenset()}
    session.is_ready, session.watched = lambda kinds: kinds in ready, True
    session.start()
    done: list[str] = []

    def ask(what: str, touch: Touch) -> None:
        def act(playground) -> None:
            if what == "grab":
                playground.grab("hand", 0, playground.points[0])
            elif what == "let go":
                playground.release("hand")
            done.append(what)

        session.ask(act, touch=touch)

    def time_goes_on() -> None:
        frame = session.picture.frame.number
        wait_until(lambda: session.picture.frame.number > frame + 5, "time goes on")

    for what, touch in (("grab", Touch.TIES), ("let go", Touch.RELEASES), ("throw", Touch.THROWS)):
        ask(what, touch)
    ask("inflate", Touch.SETS)
    wait_until(lambda: done == ["inflate"], "what is ready is granted")
    time_goes_on()
    assert done == ["inflate"]
    assert session.busy_seconds > 0.0
    assert session.picture.executed == 0 < session.asked == 4  # the panel is not pulled back meanwhile
    ready.add(frozenset({"string"}))
    session.kernels_came()
    wait_until(lambda: done == ["inflate", "grab", "let go"], "a hand lets go after it took hold")
    session.reset()
    wait_until(lambda: session.picture.executed == session.asked, "a reset forgets the throw")
    ready.add(frozenset({"sphere"}))
    time_goes_on()
    assert done[-1] == "let go"
    session.stop()


def test_a_blow_up_is_told_before_its_reason_is_known(tmp_path):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(k_normal=0.3))])
    session = Session("ball", scene, "cpu", tmp_path)
    ready: set[Kinds] = {frozenset()}
    session.is_ready, session.watched = lambda kinds: kinds in ready, True

    def blow_up() -> None:
        session.playground.keep_stable = False
        session.ask(lambda playground: playground.inflate(1e9))
        wait_until(lambda: session.picture.trouble == LOOKING, "it blows up")
        assert not session.picture.running
        assert np.abs(session.picture.frame.points[0]).max() < 5.0  # the last good shape
        wait_until(lambda: session.picture.executed == session.asked, "the panel shows its values")

    session.start()
    blow_up()
    session.reset()
    wait_until(lambda: session.picture.running and not session.picture.trouble, "a reset does not wait for the reason")
    ready.add(REASON)
    wait_until(lambda: session.picture.frame.number > 5, "time goes on")
    assert not session.picture.trouble  # that of a state which is gone is not told
    ready.remove(REASON)
    blow_up()
    ready.add(REASON)
    session.kernels_came()
    wait_until(lambda: session.picture.trouble == "Too much pressure for these springs.", "the reason is told")
    assert "inflation pushed it" in session.picture.why
    session.stop()
