"""Real time in the browser: how fast the bundled squirrel is simulated with a page open.

    python -m balloon_warp.benchmarks.viewer [SCENE] [--seconds 20]

needs the extra `test`, and Chromium. The page is drawn in software, on the same cores.
"""

import argparse
import shutil
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from balloon_warp.scene.load import load_scene
from balloon_warp.system.warp_setup import quiet_warp

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
FLAGS = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"


def main() -> None:
    """Print simulated over wall time, frames a second, and how often the page was drawn."""
    parser = argparse.ArgumentParser(description="Simulates a scene in real time with a page open.")
    parser.add_argument("scene", nargs="?", default="squirrel_inflate")
    parser.add_argument("--seconds", type=float, default=20.0, help="of measuring")
    options = parser.parse_args()
    quiet_warp()
    from playwright.sync_api import sync_playwright

    from balloon_warp.studio.page.page import Page
    from balloon_warp.studio.page.session import Session

    with TemporaryDirectory() as folder, sync_playwright() as driver:
        page = Page(Session(options.scene, load_scene(options.scene), "cpu", Path(folder)))
        page.start()
        browser = driver.chromium.launch(executable_path=find_chromium(), args=FLAGS.split())
        window = browser.new_page(viewport={"width": 1280, "height": 800})
        window.goto(page.address)
        window.get_by_text("Reset", exact=True).wait_for()
        time.sleep(5.0)  # the page has loaded, and the first frames are past
        window.evaluate(COUNT_FRAMES)
        first, began = page.session.playground.frame, time.perf_counter()
        time.sleep(options.seconds)
        frames, seconds = page.session.playground.frame - first, time.perf_counter() - began
        drawn = window.evaluate("window.drawn") / seconds
        rate = frames / seconds / page.session.scene.frames_per_second
        print(
            f"{options.scene}: {frames / seconds:.1f} simulated frames a second, {rate:.3f} of real time at speed 1; "
            f"a frame takes {1000 * page.session.picture.step_seconds:.1f} ms; the browser draws {drawn:.1f} a second"
        )
        browser.close()
        page.stop()


COUNT_FRAMES = """() => {
    window.drawn = 0;
    const count = () => { window.drawn += 1; requestAnimationFrame(count); };
    requestAnimationFrame(count);
}"""


def find_chromium() -> str:
    """Return the path of the browser's program."""
    found = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if not found:
        raise SystemExit(f"this needs Chromium; expected one of {', '.join(CHROMIUM)} on the path")
    return found


if __name__ == "__main__":
    main()
