"""Page of a design while it converges: in headless Chromium, and from the command line."""

from dataclasses import replace

import numpy as np
import pytest
from browsing import LIMIT, picture_of, wait_until
from meshes import quad_sphere
from typer.testing import CliRunner

from balloon_warp.cli import progress
from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.lab.design import measure, panels
from balloon_warp.lab.design.job import DesignStep
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.lab.design.page import DesignPage
from balloon_warp.mesh.obj import write_obj
from balloon_warp.studio.page.server import free_port

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


@pytest.mark.parametrize(
    ("asked", "labels"),
    [
        (["--steps", "1"], ["step 0", "step 1"]),
        (["--of", "latex", "--stretch", "1.3", "--steps", "1"], ["step 0", "step 1"]),
        (["--of", "foil", "--panels", "5", "--steps", "0"], ["step 0"]),
    ],
    ids=["springs", "latex", "foil"],
)
def test_command_shows_it_and_stays(asked: list[str], labels: list[str], tmp_path, monkeypatch):
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
    asked = ["design", str(tmp_path / "egg.obj"), "-o", str(tmp_path / "egg"), *asked, "--device", "cpu"]
    said = CliRunner().invoke(app, [*asked, "--view", "--port", str(free_port("127.0.0.1", 0))])
    assert said.exit_code == 0, said.output
    assert "egg.obj is at http://127.0.0.1:" in said.output
    assert [each.label for each in shown] == [*labels, "simulated from rest"]
    assert all(each.stretch for each in shown)
    assert shown[-1].error.mean <= 1.05 * shown[0].error.mean
    assert stopped == [True]


def test_outlines_of_foil_are_not_shown(tmp_path):
    said = CliRunner().invoke(app, ["design", "HEY", "--of", "foil", "-o", str(tmp_path / "hey"), "--view"])
    assert isinstance(said.exception, InputError)
    needs = "--view: needs --of springs, --of latex or panels of foil (got --of foil without --panels)"
    assert str(said.exception) == needs
