"""First controls of the panel: the most used."""

import math
from collections.abc import Callable
from typing import Any

import viser

from balloon_warp.errors import InputError
from balloon_warp.scene import Scene, bundled_scenes, load_scene
from balloon_warp.viewer import colors
from balloon_warp.viewer.dials import on_change, on_slide
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.restyled import MATERIALS, made_of, material_of
from balloon_warp.viewer.session import Session
from balloon_warp.viewer.status import row_of

SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
NUDGE = 0.04
"""Fraction of the inflation slider's range that a key or a press moves it by"""
HELD_NUDGE = 0.01
"""Fraction of the inflation slider's range that a held button moves it by every tenth of a second"""
INFLATIONS = {"k_normal": "inflation (k_normal)", "pressure": "pressure [Pa]", "pump": "pump [mol/s]"}


class HandsOn:
    """Inflate and deflate, time, the scene, and the material and color of balloons.

    Args:
        server: of the page.
        session: that the panel steers.
        look: turns a window's camera to the balloon, and lets it follow or stay.
        home: brings a window's camera back to where it was at first.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        look: Callable[[viser.ClientHandle], None],
        home: Callable[[viser.ClientHandle], None],
    ):
        self._server, self._session, self._look, self._go_home = server, session, look, home
        self._given = {session.name: session.scene}
        self._wanted = self._material = ""
        self._add_inflation()
        self._add_time()
        self._add_scene()

    def follow(self, picture: Picture) -> None:
        """Show the time, and move the inflation slider along with the scene or with keys."""
        label, icon = ("Pause", viser.Icon.PLAYER_PAUSE) if picture.running else ("Run", viser.Icon.PLAYER_PLAY)
        if self.run.label != label:
            self.run.label, self.run.icon = label, icon
        slider = self.inflation
        if picture.granted == self._session.asked and (
            abs(slider.value - picture.inflation) > 1e-3 * (slider.max - slider.min)
        ):
            put(slider, picture.inflation)

    def bind(self, picture: Picture, fresh: bool) -> None:
        """Set values to a scene's, and for a new scene the ranges, too."""
        scene = picture.scene
        if fresh:
            inflation = scene.balloon[0].inflation
            self.inflation.label = INFLATIONS[inflation.keyframed]
            most = max(max(abs(value) for _, value in inflation.keyframes) * 2.0, 1e-3)
            span(self.inflation, most, signed=inflation.keyframed == "pump")
        put(self.inflation, picture.inflation)
        self.scenes.value = picture.name
        if fresh:
            self._material, self._wanted = self._wanted or material_of(scene), ""
            self.material.options = tuple(dict.fromkeys([*MATERIALS, self._material]))
        self.material.value = self._material
        self.color.value = colors.balloon_color(scene, 0, picture.model.shapes[0].mesh)

    def _add_inflation(self) -> None:
        gui = self._server.gui
        gui.add_html(row_of(2, large=True))
        for label, icon, sign, key in (
            ("Inflate", viser.Icon.PLUS, 1.0, "I"),
            ("Deflate", viser.Icon.MINUS, -1.0, "K"),
        ):
            button = gui.add_button(label, icon=icon, hint=f"key {key}; hold it for more")
            button.on_click(lambda _, sign=sign: self._nudge(sign * NUDGE))
            button.on_hold(lambda _, sign=sign: self._nudge(sign * HELD_NUDGE))
            self._key(label, key, lambda sign=sign: self._nudge(sign * NUDGE))
        self.inflation = gui.add_slider("inflation", 0.0, 1.0, 0.001, 0.0, hint="keys I and K")
        on_slide(self.inflation, self._inflate, self._session.tell)

    def _add_time(self) -> None:
        gui, session = self._server.gui, self._session
        gui.add_html(row_of(4))
        self.run = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE, color="gray", hint="space")
        step = gui.add_button("Step", icon=viser.Icon.PLAYER_TRACK_NEXT, color="gray", hint="one frame; key N")
        reset = gui.add_button("Reset", icon=viser.Icon.RELOAD, color="gray", hint="back to the start; key R")
        follow = gui.add_button(
            "Follow", icon=viser.Icon.FOCUS_2, color="gray", hint="track the balloon, or stop; key F"
        )
        self.run.on_click(lambda _: self._toggle_run())
        step.on_click(lambda _: session.step_once())
        reset.on_click(self._reset)
        follow.on_click(lambda event: event.client and self._look(event.client))
        self._key("Pause or run", "space", self._toggle_run)
        self._key("Step one frame", "N", session.step_once)
        gui.add_command("Reset", hotkey="R").on_trigger(self._reset)
        command = gui.add_command("Follow the balloon", hotkey="F")
        command.on_trigger(lambda event: event.client and self._look(event.client))

    def _add_scene(self) -> None:
        gui, session = self._server.gui, self._session
        self.scenes = gui.add_dropdown("scene", tuple(dict.fromkeys([session.name, *bundled_scenes()])))
        self.material = gui.add_dropdown("material", list[str](MATERIALS), hint="of all balloons; restarts the scene")
        self.color = gui.add_rgb("color", colors.BRAND, hint="of all balloons")
        self.speed = gui.add_dropdown("time scale", SPEEDS, initial_value="1")
        on_change(self.scenes, self._load)
        on_change(self.material, self._make_of)
        on_change(self.color, self._paint)
        on_change(self.speed, lambda value: session.set_speed(float(value)))

    def _key(self, label: str, key: Any, act: Callable[[], None]) -> None:
        self._server.gui.add_command(label, hotkey=key).on_trigger(lambda event: act())

    def _reset(self, event: Any) -> None:
        self._session.reset()
        if event.client:
            self._go_home(event.client)

    def _toggle_run(self) -> None:
        self._session.run(not self._session.running)

    def _scene(self, name: str) -> Scene:
        if name not in self._given and name not in bundled_scenes():
            raise InputError(f"{name[:60]}: no such scene")
        return self._given.get(name) or load_scene(name)

    def _load(self, name: str) -> None:
        self._wanted = ""
        self._session.load(name, lambda: self._scene(name))

    def _make_of(self, material: str) -> None:
        name, self._wanted = self._session.name, material
        self._session.load(name, lambda: made_of(self._scene(name), material))

    def _paint(self, color: Any) -> None:
        linear = colors.linear(color)
        self._session.ask(lambda playground: playground.paint(linear), key="color")

    def _inflate(self, value: float) -> None:
        self._session.ask(lambda playground: playground.inflate(float(value)), key="inflate")

    def _nudge(self, part: float) -> None:
        slider = self.inflation

        def nudge(playground: Playground) -> None:  # from where it is: the slider may not have followed yet
            value = playground.inflation + part * (slider.max - slider.min)
            playground.inflate(min(max(value, slider.min), slider.max))

        self._session.ask(nudge)


def put(slider: Any, value: float) -> None:
    """Show a value, with as many digits as the field shows."""
    slider.value = min(max(float(f"{value:.4g}"), slider.min), slider.max)


def span(slider: Any, most: float, signed: bool) -> None:
    """Set a slider's range from 0, or as far below it, up to a value with two digits."""
    digit = 10.0 ** (math.floor(math.log10(most)) - 1)
    most = float(f"{math.ceil(most / digit - 1e-9) * digit:.2g}")
    slider.min, slider.max = -most if signed else 0.0, most
    slider.step = (slider.max - slider.min) / 1000.0
