"""Pages in use, in headless Chromium, where there is one: `view` and a design while it converges."""

import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from browsing import (
    LIMIT,
    asked,
    box,
    click_the_balloon,
    highlights,
    inflation_is,
    middle_of_the_balloon,
    open_window,
    picture_of,
    redness,
    see,
    slide,
    tethered,
    toggle,
    uncheck,
    unfold,
    volume,
    wait_until,
)
from meshes import quad_sphere
from PIL import Image
from pxr import Usd, UsdGeom
from strangers import AskedAhead
from typer.testing import CliRunner

from balloon_warp import Balloon, Scene, Water, scenes
from balloon_warp.cli import progress
from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.lab.design import measure, panels
from balloon_warp.lab.design.job import DesignStep
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.lab.design.page import DesignPage
from balloon_warp.mesh.obj import write_obj
from balloon_warp.studio.page.controls import KEYS
from balloon_warp.studio.page.page import Page
from balloon_warp.studio.page.server import free_port
from balloon_warp.studio.page.session import Session
from balloon_warp.studio.page.view import Shown

SAVES = "Saves an animated stage (USD), and a scene that replays it from its start."


def turned(served: Page) -> float:
    """Return how far the camera's direction is from that at first [1]."""
    [client] = served.server.get_clients().values()
    home, middle = served.layers.home
    now, first = np.array(client.camera.position) - client.camera.look_at, home - middle
    return float(np.linalg.norm(now / np.linalg.norm(now) - first / np.linalg.norm(first)))


def blue(window, times: float) -> int:
    """Return how many pixels are so many times as blue as red."""
    red, _, blue = np.moveaxis(picture_of(window), 2, 0)
    return int((blue > times * red).sum())


@contextmanager
def another_scene(served: Page, name: str, load: Callable[[], Scene]) -> Iterator[None]:
    """Put another scene in the place of the ball's for a while."""
    served.session.load(name, load)
    try:
        yield
    finally:
        served.session.load("ball", tethered)
        wait_until(lambda: served.session.picture.name == "ball", "the ball is back")


def test_the_slider_changes_the_volume(fresh, served):
    asked(served, 60)  # it settles
    before = volume(served)
    slide(fresh, "inflation (k_normal)", 1.0, inflation_is(served, 1.0))
    wait_until(lambda: volume(served) > 1.03 * before, "it inflates")
    slide(fresh, "inflation (k_normal)", 0.1, inflation_is(served, 0.1))
    wait_until(lambda: volume(served) < 0.99 * before, "it deflates")


def test_keys_inflate_pause_and_step(fresh, served):
    fresh.mouse.click(20, 400, button="right")  # the keys go to the page, not to a field
    was, seen = served.session.picture.inflation, turned(served)
    for _ in range(3):
        fresh.keyboard.press("i")
    wait_until(lambda: served.session.picture.inflation > was, "inflation by key")
    assert turned(served) == seen  # arrows would turn the camera, and W, A, S, D, Q and E would move it
    fresh.keyboard.press("Space")
    wait_until(lambda: not served.session.picture.running, "pause by key")
    number = served.session.picture.frame.number
    fresh.keyboard.press("n")
    wait_until(lambda: served.session.picture.frame.number == number + 1, "one frame by key")
    was = served.session.picture.inflation
    served.controls.main_controls.inflation.value = 0.0  # a slider that did not follow
    fresh.keyboard.press("i")
    wait_until(lambda: served.session.picture.inflation > was, "inflation by key, from where it is")
    see(fresh, served, fresh.get_by_text("Run", exact=True).is_visible, "it can go on")
    fresh.get_by_text("Run", exact=True).click()
    wait_until(lambda: served.session.picture.frame.number > number + 5, "run by button")


def test_dragging_pulls_the_balloon(fresh, served):
    asked(served, 20)

    def center() -> np.ndarray:
        return served.session.picture.frame.points[0].mean(axis=0)

    was = center()
    right, down = middle_of_the_balloon(fresh)
    fresh.mouse.move(right, down)
    fresh.mouse.down()
    for step in range(12):
        fresh.mouse.move(right - 15 * step, down)
        time.sleep(0.05)
    wait_until(lambda: len(served.session.picture.hands) == 1, "a hand holds it")
    wait_until(lambda: np.linalg.norm(center() - was) > 0.15, "it follows")
    fresh.mouse.up()
    wait_until(lambda: not served.session.picture.hands, "the hand lets go")
    assert len(served.session.picture.scene.string) == 1


def test_strings_are_tied_and_cut(fresh, served):
    fresh.get_by_text("Cut all strings", exact=True).click()
    wait_until(lambda: not served.session.picture.scene.string, "the string is cut")
    served.controls.tool.value = "ties a string"
    click_the_balloon(fresh, lambda: served.session.picture.scene.string, "a string is tied")
    string = served.session.picture.scene.string[0]
    assert string.anchor[1] == pytest.approx(-1.0, abs=1e-5)  # the ground


def test_toggles_change_what_is_drawn(fresh, served):
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is red")
    toggle(fresh, "smooth balloon")
    see(fresh, served, lambda: redness(fresh) < 2000, "the balloon is hidden")
    lines = {"structural springs (black)": "structural", "vertex normals": "normals", "net forces": "forces"}
    for label, name in lines.items():
        toggle(fresh, label)
        wait_until(lambda name=name: served.layers._lines[name].visible, label)
        wait_until(lambda name=name: len(served.layers._lines[name].points) > 100, label)
    toggle(fresh, "strain as color")
    wait_until(lambda: any(band.visible for band in served.layers._bands[0]), "bands of strain")
    for name in ("strain as color", "smooth balloon"):
        toggle(fresh, name)
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is back")


def test_a_recording_is_a_stage_and_a_scene_that_replays_it_and_can_be_downloaded(fresh, served):
    unfold(fresh, "Recording", SAVES)
    fresh.get_by_role("button", name="Record", exact=True).click()
    wait_until(lambda: served.session.recording, "it records")
    click_the_balloon(fresh, lambda: served.session.picture.scene.sphere, "a sphere is thrown")
    slide(fresh, "inflation (k_normal)", 0.8, inflation_is(served, 0.8))
    asked(served, 20)
    stop = fresh.get_by_role("button", name="Stop and save")
    see(fresh, served, lambda: unfold(fresh, "Recording", SAVES) or stop.is_visible(), "it can be stopped")
    stop.click()
    wait_until(lambda: not served.session.recording, "it stops")
    wait_until(lambda: list(served.session.folder.glob("*.toml")), "it is written")
    see(fresh, served, fresh.get_by_text("wrote ball_1.usdc").is_visible, "it says so")
    folder = served.session.folder
    stage = Usd.Stage.Open(str(folder / "ball_1.usdc"))
    assert UsdGeom.Mesh(stage.GetPrimAtPath("/World/mesh")).GetPointsAttr().GetNumTimeSamples() > 15
    assert stage.GetPrimAtPath("/World/Spheres/Sphere_0")
    assert stage.GetStartTimeCode() == 0
    for label, written in zip(("Stage", "Scene"), served.session.saved, strict=True):
        with fresh.expect_download() as downloading:
            fresh.get_by_role("button", name=label, exact=True).click()
        assert downloading.value.suggested_filename == written.name
        assert Path(downloading.value.path()).read_bytes() == written.read_bytes()


def test_reset_goes_back_to_the_start(fresh, served):
    slide(fresh, "inflation (k_normal)", 1.0, inflation_is(served, 1.0))
    click_the_balloon(fresh, lambda: served.session.picture.scene.sphere, "a sphere is thrown")
    fresh.get_by_text("Reset", exact=True).click()
    wait_until(lambda: not served.session.picture.scene.sphere, "reset")
    assert served.session.picture.inflation == pytest.approx(0.5)
    wait_until(
        lambda: served.controls.main_controls.inflation.value == pytest.approx(0.5, abs=1e-3), "the slider follows"
    )
    fresh.mouse.click(20, 400, button="right")
    fresh.keyboard.down("ArrowUp")  # a key of the camera
    wait_until(lambda: turned(served) > 0.2, "the camera turns")
    fresh.keyboard.up("ArrowUp")
    fresh.keyboard.press("r")
    wait_until(lambda: turned(served) < 1e-3, "the camera is back")


def test_a_blow_up_is_caught_and_undone(fresh, served):
    asked(served, 40)
    uncheck(fresh, "Advanced", "keep the step stable")
    unfold(fresh, "Balloon", "structural springs")
    stiffness = "structural springs"
    # Softer, which its substeps bear for ever: a stiffer one blows up by itself, and its good states with it.
    slide(fresh, stiffness, 30.0, lambda: served.session.picture.scene.balloon[0].stiffness.structural == 30.0)
    before = volume(served)
    served.session.set("balloon.stiffness.structural", 1e9)
    banner = fresh.locator("#bw-wrong")
    see(fresh, served, lambda: "Too few substeps for these springs." in banner.inner_text(), "it says so")
    assert not served.session.picture.running
    assert volume(served) == pytest.approx(before, rel=0.2)  # the last good shape stays
    banner.get_by_text("Go back").click()
    wait_until(lambda: not served.session.picture.trouble, "it is undone")
    see(fresh, served, lambda: not banner.inner_text(), "and nothing is wrong any more")
    assert volume(served) == pytest.approx(before, rel=0.2)
    assert served.session.picture.scene.balloon[0].stiffness.structural < 1e9
    see(fresh, served, fresh.get_by_text("Run", exact=True).is_visible, "it can go on")
    fresh.get_by_text("Run", exact=True).click()
    asked(served, 10)


def test_a_second_window_joins_and_leaves(browser, fresh, served):
    second = open_window(browser, served)
    see(second, served, second.get_by_text("Pause", exact=True).is_visible, "it can be stopped")
    second.get_by_text("Pause", exact=True).click()
    see(fresh, served, fresh.get_by_text("Run", exact=True).is_visible, "the other window sees it")
    fresh.get_by_text("Run", exact=True).click()
    wait_until(lambda: served.session.picture.running, "run by button")
    threads = threading.active_count()
    second.close()
    wait_until(lambda: len(served.server.get_clients()) == 1, "the window leaves")
    asked(served, 5)
    assert threading.active_count() <= threads


def test_time_stands_still_while_nobody_watches(browser, tmp_path):
    page = Page(Session("ball", tethered(), "cpu", tmp_path), port=free_port("127.0.0.1", 0))
    page.ahead = AskedAhead()
    before = threading.active_count()
    page.start()
    window = open_window(browser, page)
    asked(page, 10)
    window.close()
    wait_until(lambda: not page.session.watched, "nobody watches")
    pictures = [page.session.picture]
    while len(pictures) < 6:
        wait_until(lambda: page.session.picture is not pictures[-1], "another picture")
        pictures.append(page.session.picture)
    assert len({picture.frame.number for picture in pictures[2:]}) == 1  # the first may have been under way
    page.stop()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(page.address, timeout=60)
    wait_until(lambda: threading.active_count() <= before, "its threads end")


@pytest.mark.parametrize("size", [(1100, 600), (390, 844)])
def test_a_splash_is_seen_until_something_moves(browser, tmp_path, size):
    page = Page(Session("ball", tethered(), "cpu", tmp_path), port=free_port("127.0.0.1", 0))
    page.ahead = asked = AskedAhead()
    page.layers.draw(page.session.picture)
    page.controls.follow(page.session.picture)
    window = browser.new_page(viewport={"width": size[0], "height": size[1]})
    window.set_default_timeout(1000.0 * LIMIT)
    window.goto(page.address)
    window.locator(".bw-status").wait_for(state="attached")
    splash = window.locator("#bw-splash")
    assert splash.is_visible()
    page.start()
    splash.wait_for(state="detached")
    assert page.session.picture.frame.number > 0
    wait_until(lambda: asked.scenes, "it compiles ahead")
    assert asked.scenes == [page.session.picture.model.scene]
    window.close()
    page.stop()


def test_a_sphere_is_seen_at_once(fresh, served):
    done = threading.Event()
    served.session.ask(lambda _: done.wait(LIMIT))
    try:
        click_the_balloon(fresh, lambda: served.layers._coming, "a sphere is foreseen")
        see(fresh, served, lambda: blue(fresh, 1.5) > 50, "it is seen")
        assert not served.session.picture.scene.sphere
        wait_until(lambda: fresh.locator("#bw-wait").inner_text().startswith("getting ready"), "it says why it waits")
    finally:
        done.set()
    wait_until(lambda: served.session.picture.scene.sphere, "it flies")
    wait_until(lambda: served.layers._coming is None, "there is one")
    wait_until(lambda: not fresh.locator("#bw-wait").is_visible(), "nothing waits")


MODELS = Path(scenes.__file__).parent


def test_the_balloon_shines(fresh, served):
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is red")
    see(fresh, served, lambda: highlights(fresh) > 100, "it shines")


def test_a_print_is_seen(fresh, served, tmp_path):
    """A pillow's print, half green and half blue, shows by its texture coordinates: green to the left."""
    image = np.zeros((8, 8, 3), np.uint8)
    image[:, :4, 1] = image[:, 4:, 2] = 255
    Image.fromarray(image).save(tmp_path / "halves.png")
    pillow = Balloon(mesh=MODELS / "pillow.obj", print=tmp_path / "halves.png", rotation=(70.0, 0.0, 0.0))

    def columns() -> tuple[np.ndarray, np.ndarray]:
        red, green, blue = np.moveaxis(picture_of(fresh), 2, 0)
        return np.nonzero(green > 1.5 * np.maximum(red, blue))[1], np.nonzero(blue > 1.5 * np.maximum(red, green))[1]

    with another_scene(served, "pillow", lambda: Scene(balloon=[pillow], gravity=0.0)):
        served.session.run(False)
        see(fresh, served, lambda: min(len(half) for half in columns()) > 1000, "both colors are seen")
        green, blue = columns()
        assert np.median(green) < np.median(blue)


def test_water_is_seen_where_its_level_is(fresh, served):
    """Water tints all below its level blue, and the ground hides it: only springs and arrows are blue then."""
    pool = tethered().model_copy(update={"water": Water(level=0.1, density=1.0)})
    with another_scene(served, "pool", lambda: pool):
        served.session.run(False)
        see(fresh, served, lambda: blue(fresh, 1.2) > 10_000, "water is seen")
        above = redness(fresh)
        served.session.set("water.level", -2.0)
        served.session.step_once()
        see(fresh, served, lambda: blue(fresh, 1.2) < 400, "the ground hides it")
        assert redness(fresh) > 1.3 * above


def test_the_panel_leaves_the_balloon_in_the_middle_of_the_view(fresh, served):
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is red")
    free, panel = box(fresh, "canvas[data-engine]"), fresh.get_by_text("Reset", exact=True).bounding_box()
    assert 0 < free["x"] + free["width"] <= panel["x"]
    fresh.set_viewport_size({"width": 390, "height": 844})
    try:
        drawer = '[style*="max-height: 60%"]'
        wait_until(lambda: 0 < box(fresh, drawer)["height"] < 100, "the drawer is folded")
        wait_until(lambda: above(fresh, drawer), "the view is above")
        fresh.locator(f'{drawer} [style*="cursor: pointer"]').first.click()
        wait_until(lambda: box(fresh, drawer)["height"] > 300, "the drawer opens")
        wait_until(lambda: above(fresh, drawer), "the view is above")
        assert box(fresh, drawer)["width"] == 390
    finally:
        fresh.set_viewport_size({"width": 1100, "height": 600})
    fresh.get_by_text("Reset", exact=True).wait_for()


def test_keys_are_on_a_sheet(fresh, served):
    fresh.mouse.click(20, 400, button="right")
    fresh.keyboard.press("?")
    sheet = fresh.locator(".bw-sheet")
    sheet.wait_for()
    assert sheet.locator("tr").count() == len(KEYS)
    fresh.keyboard.press("?")
    sheet.wait_for(state="detached")
    button = box(fresh, ".bw-keys-button")
    fresh.mouse.click(button["x"] + button["width"] / 2, button["y"] + button["height"] / 2)
    sheet.wait_for()
    fresh.keyboard.press("Escape")
    sheet.wait_for(state="detached")


def test_the_camera_follows(fresh, served):
    [client] = served.server.get_clients().values()
    camera, follows = client.camera, lambda: served.follower.follows(client)

    def beside() -> float:
        return float(np.linalg.norm(np.array(camera.look_at) - served.session.picture.frame.points[0].mean(axis=0)))

    fresh.mouse.click(20, 400, button="right")
    fresh.keyboard.press("f")
    wait_until(follows, "it follows")
    served.session.ask(lambda playground: playground.cut_all())  # and so it rises
    served.session.set("balloon.helium", 30.0)
    start = served.session.picture.frame.points[0].mean(axis=0)[1]
    wait_until(lambda: served.session.picture.frame.points[0].mean(axis=0)[1] > start + 2.0, "it rises")
    wait_until(lambda: beside() < 0.3, "the camera rises along")
    fresh.keyboard.press("f")
    wait_until(lambda: not follows(), "it stays")
    wait_until(lambda: beside() > 1.0, "the balloon goes on")
    served.session.reset()
    wait_until(lambda: served.session.picture.frame.points[0].mean(axis=0)[1] < start + 0.5, "it is back")
    for _ in range(2):  # look at it, and stay, for whoever comes next
        fresh.keyboard.press("f")
    wait_until(lambda: beside() < 0.3 and not follows(), "the camera is back")


def test_a_notebook_shows_the_page(browser, fresh, served):
    html = Shown(served, ("100%", 400))._repr_html_()

    class Notebook(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(html.encode())

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Notebook) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        notebook, said = browser.new_page(), []
        notebook.on("console", lambda message: said.append(message.text))
        notebook.goto(f"http://elsewhere.localhost:{server.server_port}")
        wait_until(lambda: notebook.wait_for_timeout(20) or any("frame-ancestors" in text for text in said), "refused")
        notebook.goto(f"http://localhost:{server.server_port}")
        notebook.frame_locator("iframe").get_by_text("Reset", exact=True).wait_for(timeout=1000.0 * LIMIT)
        notebook.close()
        server.shutdown()
    wait_until(lambda: len(served.server.get_clients()) == 1, "the notebook is closed")


def above(window, drawer: str) -> bool:
    """Return whether the view ends where the drawer begins, to a pixel."""
    return abs(box(window, "canvas[data-engine]")["height"] - box(window, drawer)["y"]) <= 1.0


def test_a_button_that_is_held_inflates_on(fresh, served):
    """Presses under way at the release still count, so each is held until the number has passed."""

    def hold(name: str, happened: Callable[[], bool]) -> None:
        button = fresh.get_by_role("button", name=name, exact=True).bounding_box()
        fresh.mouse.move(button["x"] + 20, button["y"] + 20)
        fresh.mouse.down()
        wait_until(happened, f"{name} goes on")
        fresh.mouse.up()

    was = served.session.picture.inflation
    hold("Inflate", lambda: served.session.picture.inflation > was + 0.1)
    hold("Deflate", lambda: served.session.picture.inflation < was + 0.05)


def test_a_number_stays_within_its_slider_and_says_so(fresh, served):
    dials = [each for _, dials in served.controls._folders for each in dials]
    [dial] = [each for each in dials if each.value.label == "structural springs"]

    def stiffness() -> float:
        return served.session.picture.scene.balloon[0].stiffness.structural

    unfold(fresh, "Balloon", "structural springs")
    slide(fresh, "structural springs", 1e9, lambda: stiffness() == 400.0)
    see(fresh, served, fresh.get_by_text("structural springs: 400 is the maximum here").first.is_visible, "it says so")
    assert dial.slider.value == 1.0
    slide(fresh, "structural springs", 4.0, lambda: stiffness() == 4.0)
    assert dial.slider.value == pytest.approx(-1.0)
    slide(fresh, "structural springs", 40.0, lambda: stiffness() == 40.0)
    assert dial.slider.value == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("material", ["latex", "foil", "nylon"])
def test_the_menu_makes_balloons_of_another_material(fresh, served, material):

    def choose(name: str) -> None:
        fresh.locator("xpath=//label[normalize-space()='material']/following::input[1]").click()
        fresh.get_by_role("option", name=name, exact=True).click()

    load = served.session.picture.load
    choose(material)
    wait_until(lambda: served.session.picture.load > load, "it is loaded")
    made = served.session.picture.scene.balloon[0]
    assert made.material.preset == ("latex" if material == "latex" else None)
    assert made.look == (None if material == "latex" else "foil")
    asked(served, 5)
    wait_until(lambda: served.controls.main_controls.material.value == material, "the menu says it")
    choose("springs")
    wait_until(lambda: served.session.picture.load > load + 1, "it is loaded")
    again = served.session.picture.scene.balloon[0]
    assert (again.material.preset, again.look, again.stiffness.structural) == (None, None, 40.0)


RULER = Ruler(quad_sphere(4, 0.15))


def step(number: int, longer: float, proven: bool = False) -> DesignStep:
    """Return a design step with a ball that is too long."""
    return DesignStep(RULER, number, RULER.mesh.points * [1.0, 1.0, longer], 1.2, proven)


def colors(window) -> tuple[int, int]:
    """Return the numbers of red and of blue pixels."""
    red, _, blue = np.moveaxis(picture_of(window)[:, 320:], 2, 0)  # beside the messages
    return int((red > 1.3 * blue).sum()), int((blue > 1.15 * red).sum())


def test_colors_say_how_far_it_is_off(browser):
    page = DesignPage(port=free_port("127.0.0.1", 0))
    page.show(step(0, 1.4))
    window = browser.new_page(viewport={"width": 1100, "height": 600})
    window.set_default_timeout(1000.0 * LIMIT)
    window.goto(page.address)
    window.get_by_text("step 0", exact=True).wait_for()
    window.get_by_text("mean stretch 1.2").wait_for()
    wait_until(lambda: colors(window)[0] > 500, "far places are red")
    page.show(step(1, 1.0))
    window.get_by_text("step 1", exact=True).wait_for()
    wait_until(lambda: colors(window)[0] < 50 and colors(window)[1] > 500, "near ones are blue")
    window.get_by_text("mean error [% of the size] by step").wait_for()
    page.show(step(1, 1.0, proven=True))
    window.get_by_text("simulated from rest", exact=True).wait_for()
    window.close()
    page.stop()


@pytest.mark.parametrize(("kind", "steps"), [("springs", 1), ("latex --stretch 1.3", 1), ("foil --panels 5", 0)])
def test_command_shows_it_and_stays(kind: str, steps: int, tmp_path, monkeypatch):
    monkeypatch.setattr(measure, "SIZE", (96, 84))
    monkeypatch.setattr(panels, "EDGES", 6)
    shown, stopped = list[DesignStep](), list[bool]()
    monkeypatch.setattr(DesignPage, "show", lambda self, step: shown.append(step))
    monkeypatch.setattr(DesignPage, "stop", lambda self: (stopped.append(True), self.server.stop()))

    def ctrl_c() -> None:
        assert not stopped
        raise KeyboardInterrupt

    monkeypatch.setattr(progress, "stay", ctrl_c)
    write_obj(tmp_path / "egg.obj", replace(RULER.mesh, points=RULER.mesh.points * [1.0, 1.3, 1.0]))
    asked = f"--of {kind} --steps {steps} --device cpu --view --port {free_port('127.0.0.1', 0)}".split()
    said = CliRunner().invoke(app, ["design", str(tmp_path / "egg.obj"), "-o", str(tmp_path / "egg"), *asked])
    assert said.exit_code == 0, said.output
    assert "egg.obj is at http://127.0.0.1:" in said.output
    assert [each.label for each in shown] == [*(f"step {n}" for n in range(steps + 1)), "simulated from rest"]
    assert all(each.stretch for each in shown)
    assert shown[-1].error.mean <= 1.05 * shown[0].error.mean
    assert stopped == [True]


def test_outlines_of_foil_are_not_shown(tmp_path):
    said = CliRunner().invoke(app, ["design", "HEY", "--of", "foil", "-o", str(tmp_path / "hey"), "--view"])
    assert isinstance(said.exception, InputError)
    needs = "--view: needs --of springs, --of latex or panels of foil (got --of foil without --panels)"
    assert str(said.exception) == needs
