"""The page of a design while it converges: the balloon as it is now, error as color."""

import sys
import threading
from collections.abc import Callable

import numpy as np
import trimesh
import viser
from viser import uplot

from balloon_warp.lab.design.job import DesignStep
from balloon_warp.lab.design.measure import FULL, error_colors
from balloon_warp.mesh.topology import triangulate
from balloon_warp.studio.page.drawings import go_home, home_of
from balloon_warp.studio.page.server import address_of, close, guarded_server

UP, SIDE = np.array([0.0, 1.0, 0.0]), np.array([0.55, 0.0, 1.0])
LIGHT = 2.8
WANTED = (90, 80, 70)
"""Color of the wires of the target shape"""
SHADES = 40
"""Number of bands of the color legend"""


class DesignPage:
    """Shows the steps of a design.

    Args:
        host: address to listen on.
        port: to listen on; 8080 or the next free one, when missing.
        on_refused: told once of each origin that may not talk to it, in a sentence.

    Raises:
        InputError: the page cannot be served there.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int | None = None,
        on_refused: Callable[[str], None] = lambda sentence: print(sentence, file=sys.stderr),
    ):
        self.server = guarded_server(host, port, (), on_refused)
        self.server.scene.set_up_direction("+y")
        self.server.scene.configure_default_lights(enabled=False)
        self.server.scene.add_light_directional("/light", intensity=LIGHT, cast_shadow=True)
        self.server.on_client_connect(self._welcome)
        self.steps: list[DesignStep] = []
        self._status = self.server.gui.add_html('<div class="bw-status"><span>begins</span></div>')
        self._said = self.server.gui.add_html("")
        self.server.gui.add_html(_legend())
        self._wires = self.server.gui.add_checkbox("target shape", initial_value=False)
        self._wires.on_update(lambda _: self._show_wanted())
        self._plot: viser.GuiUplotHandle | None = None
        self._lock = threading.Lock()

    @property
    def address(self) -> str:
        """Address of the page."""
        return address_of(self.server)

    def show(self, step: DesignStep) -> None:
        """Draw the balloon of a step, and report its error."""
        with self._lock, self.server.atomic():
            first = not self.steps
            self.steps.append(step)
            self._draw(step)
            self._status.content = _status(step)
            self._said.content = _details(step)
            self._draw_plot()
            if first:
                self._begin(step)
        self.server.flush()

    def stop(self) -> None:
        """End the server."""
        close(self.server)

    def _begin(self, step: DesignStep) -> None:
        """Look at the wanted shape from where all of it is seen."""
        self._show_wanted()
        self.home = home_of(step.ruler.mesh.points, UP, SIDE)
        for camera in [self.server.initial_camera, *(each.camera for each in self.server.get_clients().values())]:
            go_home(camera, *self.home)

    def _draw(self, step: DesignStep) -> None:
        triangles, _ = triangulate(step.ruler.mesh)
        colors = np.round(255.0 * error_colors(step.off)).astype(np.uint8)
        shape = trimesh.Trimesh(step.placed, triangles, vertex_colors=colors, process=False)
        _ = shape.vertex_normals  # which are sent if they are there: without, every triangle looks flat
        self.server.scene.add_mesh_trimesh("/balloon", shape)

    def _show_wanted(self) -> None:
        if not self.steps:
            return
        mesh = self.steps[0].ruler.mesh
        triangles, _ = triangulate(mesh)
        self.server.scene.add_mesh_simple(
            "/wanted",
            mesh.points,
            triangles,
            color=WANTED,
            wireframe=True,
            visible=self._wires.value,
            cast_shadow=False,
        )

    def _draw_plot(self) -> None:
        """Plot the mean error over the steps, once there are two."""
        steps = [step for step in self.steps if not step.proven]
        if len(steps) < 2:
            return
        numbers = np.array([step.number for step in steps], dtype=float)
        errors = 100.0 * np.array([step.error.mean for step in steps])
        data = (numbers, errors, np.linspace(0.0, 1.05 * max(errors.max(), 1e-3), len(numbers)))
        if self._plot is not None:
            self._plot.data = data
            return
        self._plot = self.server.gui.add_uplot(
            data=data,
            series=(
                uplot.Series(label="step"),
                uplot.Series(label="mean error [% of the size]", stroke="#c82824", width=2),
                uplot.Series(stroke="transparent", width=0),  # lets the axis begin at 0
            ),
            scales={"x": uplot.Scale(time=False)},
            legend=uplot.Legend(show=False),
            title="mean error [% of the size] by step",
            height=150,
        )

    async def _welcome(self, client: viser.ClientHandle) -> None:
        if self.steps:
            go_home(client.camera, *self.home)


def _status(step: DesignStep) -> str:
    return f'<div class="bw-status" data-moves><span><b>{step.label}</b></span></div>'


def _details(step: DesignStep) -> str:
    stretch = "" if step.stretch is None else f"<br>mean stretch {step.stretch:.3g}"
    return f'<div class="bw-details">error {step.error} of the size{stretch}<br>{len(step.points):,} vertices</div>'


def _legend() -> str:
    """Return the legend of the colors."""
    colors = np.round(255.0 * error_colors(np.linspace(0.0, FULL, SHADES))).astype(int)
    cells = "".join(
        f'<div style="flex:1;height:0.6em;background:rgb{tuple(color.tolist())}"></div>' for color in colors
    )
    ends = f"<span>0</span><span>{50.0 * FULL:g}</span><span>{100.0 * FULL:g} and more</span>"
    return (
        '<div style="font-size:0.8em;margin:0 1.2em">distance to the target shape, % of its size</div><div '
        f'style="display:flex;margin:0.2em 1.2em 0">{cells}</div><div '
        f'style="display:flex;justify-content:space-between;font-size:0.7em;margin:0 1.2em 0.8em">{ends}</div>'
    )
