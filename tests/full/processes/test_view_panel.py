"""Main controls of the page: in headless Chromium, where there is one."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from browsing import asked, redness, see, slide, tethered, unfold, wait_until

from balloon_warp.scene import load_scene

pytest.importorskip("viser")
pytest.importorskip("playwright.sync_api")

from balloon_warp.viewer.page import Page
from balloon_warp.viewer.server import free_port
from balloon_warp.viewer.session import Session

FIELD_OF_VIEW = np.radians(75.0)
"""of viser's camera, from bottom to top"""


def test_what_people_reach_for_is_large_and_first(fresh, served):
    """Inflate and Deflate are on top, side by side; below them a row of four, with icons."""
    boxes = {
        name: fresh.get_by_role("button", name=name, exact=True).first.bounding_box()
        for name in ("Inflate", "Deflate", "Pause", "Step", "Reset", "Follow")
    }
    large, row = list(boxes.values())[:2], list(boxes.values())[2:]
    for side_by_side in (large, row):
        assert len({round(box["y"]) for box in side_by_side}) == 1
        assert all(a["x"] + a["width"] <= b["x"] for a, b in pairwise(side_by_side))
    assert min(box["height"] for box in large) > 36
    assert large[0]["y"] < row[0]["y"] < fresh.get_by_text("scene", exact=True).bounding_box()["y"]


def test_a_button_that_is_held_inflates_on(fresh, served):
    """A held button inflates until released, and the other deflates: presses under way at the release still count, so
    each is held until the number has passed."""

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
    """A number is limited to ten times the scene's value, with a message, and the slider follows it."""
    [dial] = [
        each for _, dials in served.controls._folders for each in dials if each.value.label == "structural springs"
    ]

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
    """The menu of materials has the scene's own, too."""

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
    wait_until(lambda: served.controls.hands_on.material.value == material, "the menu says it")
    choose("springs")
    wait_until(lambda: served.session.picture.load > load + 1, "it is loaded")
    again = served.session.picture.scene.balloon[0]
    assert (again.material.preset, again.look, again.stiffness.structural) == (None, None, 40.0)


def test_balloons_take_a_color(fresh, served):
    """A color applies to the page and to the recording."""
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is red")
    served.controls.hands_on._paint((20, 60, 220))
    see(fresh, served, lambda: redness(fresh) < 2000, "it is blue")
    assert served.session.playground.journal.scene(3).balloon[0].color[2] > 0.5
    served.controls.hands_on._paint((220, 40, 30))
    see(fresh, served, lambda: redness(fresh) > 10_000, "it is red again")


def test_a_recording_can_be_downloaded(fresh, served):
    """A recording's two files are downloaded as they are in the folder."""
    served.session.record(True)
    asked(served, 5)
    served.session.record(False)
    wait_until(lambda: served.session.saved, "it is written")
    unfold(fresh, "Recording", "Saves an animated stage (USD), and a scene that replays it from its start.")
    for label, written in zip(("Stage", "Scene"), served.session.saved, strict=True):
        with fresh.expect_download() as downloading:
            fresh.get_by_role("button", name=label, exact=True).click()
        assert downloading.value.suggested_filename == written.name
        assert Path(downloading.value.path()).read_bytes() == written.read_bytes()


@pytest.mark.parametrize("name", ["balloon_bunch", "squirrel_tether"])
def test_a_scene_fills_the_view(name: str, tmp_path):
    """Strings and balloons, as they start, fill more than half of the view's height; after a switch of scenes, too."""
    page = Page(Session("ball", tethered(), "cpu", tmp_path), port=free_port("127.0.0.1", 0))
    page.layers.draw(page.session.picture)
    other = Session(name, load_scene(name), "cpu", tmp_path)
    other._load += 1
    other._show()
    page.layers.draw(other.picture)
    position, middle = page.layers.home
    anchors = np.array([string.anchor for string in other.picture.scene.string])
    seen = np.concatenate([*other.picture.frame.points, anchors]) - position
    ahead = (middle - position) / np.linalg.norm(middle - position)
    up = np.array([0.0, 1.0, 0.0]) - ahead[1] * ahead
    heights = (seen @ up / np.linalg.norm(up)) / (seen @ ahead) / np.tan(FIELD_OF_VIEW / 2)
    assert 1.0 < heights.max() - heights.min() < 2.0
    page.stop()
