"""Page in use: in headless Chromium, where there is one."""

import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from asked_ahead import AskedAhead
from browsing import (
    asked,
    click_inside,
    click_the_balloon,
    inflation_is,
    middle_of_the_balloon,
    open_window,
    redness,
    see,
    slide,
    tethered,
    toggle,
    unfold,
    volume,
    wait_until,
)
from pxr import Usd, UsdGeom

viser = pytest.importorskip("viser")
pytest.importorskip("playwright.sync_api")

from balloon_warp.viewer.page import Page  # noqa: E402
from balloon_warp.viewer.server import free_port  # noqa: E402
from balloon_warp.viewer.session import Session  # noqa: E402

SAVES = "Saves an animated stage (USD), and a scene that replays it from its start."


def test_the_slider_changes_the_volume(fresh, served):
    asked(served, 60)  # it settles
    before = volume(served)
    slide(fresh, "inflation (k_normal)", 1.0, inflation_is(served, 1.0))
    wait_until(lambda: volume(served) > 1.03 * before, "it inflates")
    slide(fresh, "inflation (k_normal)", 0.1, inflation_is(served, 0.1))
    wait_until(lambda: volume(served) < 0.99 * before, "it deflates")


def test_keys_inflate_pause_and_step(fresh, served):
    fresh.mouse.click(20, 400, button="right")  # the keys go to the page, not to a field
    was = served.session.picture.inflation
    for _ in range(3):
        fresh.keyboard.press("ArrowUp")
    wait_until(lambda: served.session.picture.inflation > was, "inflation by key")
    fresh.keyboard.press("Space")
    wait_until(lambda: not served.session.picture.running, "pause by key")
    number = served.session.picture.frame.number
    fresh.keyboard.press("n")
    wait_until(lambda: served.session.picture.frame.number == number + 1, "one frame by key")
    was = served.session.picture.inflation
    served.controls.hands_on.inflation.value = 0.0  # a slider that did not follow
    fresh.keyboard.press("ArrowUp")
    wait_until(lambda: served.session.picture.inflation > was, "inflation by key, from where it is")
    see(fresh, served, fresh.get_by_text("Run", exact=True).is_visible, "it can go on")
    fresh.get_by_text("Run", exact=True).click()
    wait_until(lambda: served.session.picture.frame.number > number + 5, "run by button")


def test_a_click_throws_a_sphere_that_dents_the_balloon(fresh, served):
    asked(served, 80)  # it settles
    before = volume(served)
    served.controls.mass.value = 10.0
    served.session.set_speed(0.25)  # so that no moment is missed
    gaps, volumes = [], []

    def dents() -> bool:
        """Return whether a sphere has touched the balloon and its volume has fallen."""
        picture = served.session.picture
        if picture.scene.sphere and len(picture.frame.sphere_positions):
            arms = picture.frame.points[0][:, None] - picture.frame.sphere_positions
            gaps.append(np.linalg.norm(arms, axis=-1).min() / float(picture.scene.sphere[0].radius))
            volumes.append(volume(served))
        return min(gaps, default=np.inf) < 1.02 and min(volumes) < 0.99 * before

    click_the_balloon(fresh, dents, "a sphere dents it")  # again, where a window that is behind let one miss


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
    for label, name in (
        ("structural springs (black)", "structural"),
        ("vertex normals", "normals"),
        ("net forces", "forces"),
    ):
        toggle(fresh, label)
        wait_until(lambda name=name: served.layers._lines[name].visible, label)
        wait_until(lambda name=name: len(served.layers._lines[name].points) > 100, label)
    toggle(fresh, "strain as color")
    wait_until(lambda: any(band.visible for band in served.layers._bands[0]), "bands of strain")
    for name in ("strain as color", "smooth balloon"):
        toggle(fresh, name)
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is back")


def test_a_recording_is_a_stage_and_a_scene_that_replays_it(fresh, served):
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


def test_reset_goes_back_to_the_start(fresh, served):
    slide(fresh, "inflation (k_normal)", 1.0, inflation_is(served, 1.0))
    click_the_balloon(fresh, lambda: served.session.picture.scene.sphere, "a sphere is thrown")
    fresh.get_by_text("Reset", exact=True).click()
    wait_until(lambda: not served.session.picture.scene.sphere, "reset")
    assert served.session.picture.inflation == pytest.approx(0.5)
    wait_until(lambda: served.controls.hands_on.inflation.value == pytest.approx(0.5, abs=1e-3), "the slider follows")


def test_a_blow_up_is_caught_and_undone(fresh, served):
    asked(served, 40)
    click_inside(fresh, "Advanced", "keep the step stable")
    unfold(fresh, "Balloon", "structural springs")
    stiffness = "structural springs"
    # Softer, which its substeps bear for ever: what is stiffer blows up by itself, and its good states with it.
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
