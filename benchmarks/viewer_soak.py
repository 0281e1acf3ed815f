"""Soak test of the viewer: random clicks, drags, keys and values, while memory is watched.

    python -m balloon_warp.benchmarks.viewer_soak [--minutes 10] [--seed 0]

needs the extra `test`, and Chromium. Prints the memory of this process each 15 seconds, and its slope over the second
half; exits with 1 if anything broke.
"""

import argparse
import contextlib
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from balloon_warp.benchmarks.viewer import FLAGS, find_chromium
from balloon_warp.scene.load import load_scene
from balloon_warp.system.warp_setup import quiet_warp

SCENES = ("squirrel_inflate", "squirrel_tether", "sphere_launch", "bowl_to_sphere")
KEYS = ("ArrowUp", "ArrowDown", "Space", "n", "r", "c", "f")


def main() -> None:
    """Play at random."""
    parser = argparse.ArgumentParser(description="Plays at random in the browser.")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    quiet_warp()
    from playwright.sync_api import TimeoutError, sync_playwright

    from balloon_warp.studio.page.page import Page
    from balloon_warp.studio.page.session import Session

    random = np.random.default_rng(options.seed)
    with TemporaryDirectory() as folder, sync_playwright() as driver:
        page = Page(Session(SCENES[0], load_scene(SCENES[0]), "cpu", Path(folder)))
        page.start()
        browser = driver.chromium.launch(executable_path=find_chromium(), args=FLAGS.split())
        window = browser.new_page(viewport={"width": 1100, "height": 900})
        window.goto(page.address)
        window.get_by_text("Reset", exact=True).wait_for()
        for name in ("Balloon", "Show"):
            window.get_by_text(name, exact=True).click()
        began, samples, acts, printed = time.monotonic(), [], 0, -15.0
        while (passed := time.monotonic() - began) < 60.0 * options.minutes:
            with contextlib.suppress(TimeoutError):  # of a browser that draws too slowly to be clicked
                act_at_random(random, window, page)
            acts += 1
            samples.append((passed / 60.0, resident_megabytes()))
            if passed - printed >= 15.0:
                printed = passed
                picture = page.session.picture
                print(
                    f"{passed:5.0f} s  {samples[-1][1]:6.1f} MB  {acts} acts, frame {picture.frame.number}", flush=True
                )
        for file in Path(folder).iterdir():
            file.unlink()
        alive = page.session._thread.is_alive() and page._thread.is_alive()
        browser.close()
        page.stop()
    minutes, megabytes = np.array([sample for sample in samples if sample[0] > options.minutes / 2]).T
    slope = float(np.polyfit(minutes, megabytes, 1)[0])
    print(f"{acts} acts in {options.minutes:g} minutes; memory grew by {slope:.2f} MB a minute in the second half")
    if not alive:
        sys.exit("a thread of the page died")


def act_at_random(random: np.random.Generator, window: Any, page: Any) -> None:
    """Act like a restless user, once."""
    kind = random.choice(["click", "drag", "key", "value", "toggle", "scene", "rest"], p=RESTLESS)
    x, y = (float(place) for place in random.uniform((50, 100), (700, 800)))
    if kind == "click":
        window.mouse.click(x, y)
    elif kind == "drag":
        window.mouse.move(400.0, 450.0)
        window.mouse.down()
        for part in np.linspace(0.0, 1.0, 6):
            window.mouse.move(400.0 + part * (x - 400.0), 450.0 + part * (y - 450.0))
        window.mouse.up()
    elif kind == "key":
        window.keyboard.press(str(random.choice(KEYS)))
    elif kind in ("value", "toggle"):
        fields = window.locator(
            "input[inputmode=decimal]:visible" if kind == "value" else "input[type=checkbox]:visible"
        )
        count = fields.count()
        if count and kind == "value":
            field = fields.nth(int(random.integers(count)))
            field.fill(f"{random.choice([0.0, 0.1, 1.0, 10.0, 1000.0]) * random.random():.3f}", timeout=5000)
            field.press("Enter")
        elif count:
            fields.nth(int(random.integers(count))).click(timeout=5000)
    elif kind == "scene":
        name = str(random.choice(SCENES))
        page.session.load(name, lambda: load_scene(name))
    else:
        time.sleep(0.5)
    if page.session.picture.trouble:
        page.session.go_back()
        page.session.run(True)
    elif not page.session.picture.running and random.random() < 0.5:
        page.session.run(True)


RESTLESS = (0.3, 0.2, 0.15, 0.15, 0.1, 0.02, 0.08)


def resident_megabytes() -> float:
    """Return the memory of this process, which simulates and serves [MB]."""
    fields = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(fields["VmRSS"].split()[0]) / 1024


if __name__ == "__main__":
    main()
