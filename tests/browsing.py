"""Helpers that act as a person at the page, in a browser."""

import contextlib
import time
from collections.abc import Callable

import numpy as np
import pytest
from meshes import quad_sphere
from numpy.typing import NDArray
from strangers import LIMIT
from strangers import wait_until as wait_until

from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Stiffness, String

viser = pytest.importorskip("viser")
playwright = pytest.importorskip("playwright.sync_api")
from balloon_warp.studio.page.page import Page  # noqa: E402

PATIENCE = 10.0
"""seconds after which a person tries again"""

SELDOM = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (drawing) => setTimeout(() => draw(drawing), 100);
window.cancelAnimationFrame = clearTimeout;
"""
"""draws ten times a second: without a GPU a window would take a core, of the two that tests share"""


def tethered() -> Scene:
    """Return a ball on a string, small enough for software rendering to keep up."""
    springs = Stiffness(structural=40.0, shear=20.0, flexion=10.0)
    ball = {"mesh": quad_sphere(5, 0.5), "stiffness": springs, "inflation": Inflation(k_normal=0.5)}
    balloon, string = Balloon(**ball, mass=1.0, damping=4.0, helium=9.81), String(anchor=(0, -1, 0), stiffness=40.0)
    return Scene(normals="cached", balloon=[balloon], string=[string], ground=Ground(height=-1.0))


def open_window(browser, served: Page, fetched: list[str] | None = None):
    before = len(served.server.get_clients())
    window = browser.new_page(viewport={"width": 1100, "height": 600})
    window.add_init_script(SELDOM)
    window.set_default_timeout(1000.0 * LIMIT)
    if fetched is not None:
        window.on("request", lambda request: fetched.append(request.url))
    window.goto(served.address)
    wait_until(lambda: len(served.server.get_clients()) == before + 1, "the window joins")
    window.get_by_text("Reset", exact=True).wait_for()
    return window


def see(window, served: Page, happened: Callable[[], object], what: str) -> None:
    """Wait until a window shows something, and reload it if it draws nothing new, as a person would: a browser without
    a GPU may lose its WebGL context."""
    seen, deadline = [time_shown(window), time.monotonic()], time.monotonic() + LIMIT
    while not happened():
        now, shown = time.monotonic(), time_shown(window)
        if shown != seen[0] or f"<b>{shown}</b>" in served.controls.status.content:
            seen = [shown, now]
        elif now - seen[1] > PATIENCE:
            window.reload()
            window.get_by_text("Reset", exact=True).wait_for()
        assert now < deadline, f"{what}: not within {LIMIT:g} s; the window shows {shown}, and does not stand still"
        time.sleep(0.05)


def time_shown(window) -> str:
    """Return the simulated time that the panel shows, such as "1.23 s"."""
    return window.evaluate("(/[0-9.]+ s(?= ·)/.exec(document.body.innerText) || [''])[0]")


def again(act: Callable[[], object], happened: Callable[[], object], what: str) -> None:
    """Repeat an action until it has its effect, as people do where the machine was too busy to notice."""
    for _ in range(int(LIMIT / PATIENCE)):
        act()
        with contextlib.suppress(AssertionError):
            return wait_until(happened, what, PATIENCE)
    raise AssertionError(f"{what}: tried for {LIMIT:g} s")


def volume(served: Page) -> float:
    return served.layers.drawing.measures(served.session.picture)["volume"]


def asked(served: Page, frames: int = 2) -> None:
    """Wait for some frames, so that a request is carried out and its result seen."""
    number = served.session.picture.frame.number
    wait_until(lambda: served.session.picture.frame.number >= number + frames, "frames pass")


def slide(window, label: str, value: float, heard: Callable[[], bool]) -> None:
    """Type a value beside a slider."""
    field = window.locator(f"xpath=//label[normalize-space()='{label}']/following::input[not(@type='hidden')][1]")

    def type_it() -> None:
        field.fill("")  # or the same number is no change
        field.fill(str(value))
        field.press("Enter")

    again(type_it, heard, f"{label} is {value:g}")


def inflation_is(served: Page, value: float) -> Callable[[], bool]:
    return lambda: served.session.picture.inflation == value


def click_the_balloon(window, happened: Callable[[], object], what: str) -> None:
    again(lambda: window.mouse.click(*middle_of_the_balloon(window)), happened, what)


def unfold(window, folder: str, inside: str) -> None:
    if not window.get_by_text(inside, exact=True).is_visible():
        window.get_by_text(folder, exact=True).click()
        window.get_by_text(inside, exact=True).wait_for()


def uncheck(window, folder: str, label: str) -> None:
    """Take a mark away inside a folder, even if a panel rebuilt meanwhile has folded it again."""
    for patience in (5_000, 10_000, 30_000):  # [ms]
        unfold(window, folder, label)
        with contextlib.suppress(playwright.TimeoutError):
            return window.get_by_label(label).uncheck(timeout=patience)
    raise AssertionError(f"{label}: could not be unchecked")


def toggle(window, label: str) -> None:
    unfold(window, "Show", "smooth balloon")
    window.get_by_label(label, exact=True).click()


def redness(window) -> int:
    """Return the number of pixels beside the panel that are as red as the balloon."""
    return int(red(window).sum())


def middle_of_the_balloon(window) -> tuple[float, float]:
    """Return the balloon's center in the window, right and down from its corner, once it is drawn."""
    wait_until(lambda: red(window)[:, 320:].any(), "the balloon is drawn")  # beside the messages
    rows, columns = np.nonzero(red(window)[:, 320:])
    return 320.0 + float(columns.mean()), float(rows.mean())


def highlights(window) -> int:
    """Return the number of pixels in the middle of the balloon that are nearly white."""
    rows, columns = np.nonzero(red(window)[:, 320:])  # beside the messages
    pixels = picture_of(window)[rows.min() : rows.max(), 320 + columns.min() : 320 + columns.max()]
    middle = pixels[len(pixels) // 4 : -len(pixels) // 4, pixels.shape[1] // 4 : -pixels.shape[1] // 4]  # no backdrop
    return int((middle[..., 1] > 150).sum())


def box(window, found: str) -> dict[str, float]:
    """Return the place and size of an element in a window, right and down from its corner; nothing if there is none."""
    there = window.locator(found)
    nowhere = {"x": 0.0, "y": 0.0, "width": 0.0, "height": 0.0}
    return (there.first.bounding_box() if there.count() else None) or nowhere


def red(window) -> NDArray[np.bool_]:
    """Return the mask of the pixels beside the panel that are as red as the balloon."""
    pixels = picture_of(window)
    return (pixels[..., 0] > 1.6 * pixels[..., 1]) & (pixels[..., 0] > 90)


def picture_of(window) -> NDArray[np.int_]:
    """Return the picture beside the panel, shape (rows, columns, 3)."""
    from io import BytesIO

    from PIL import Image

    return np.asarray(Image.open(BytesIO(window.screenshot())).convert("RGB"), dtype=int)[:, :770]
