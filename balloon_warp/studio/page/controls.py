"""The panel: first controls, sliders of everything else, plots and the status line."""

import math
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, get_args

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot
from viser._messages import GuiSliderMark

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import PARAMETERS, Law, Parameter
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.model.parameters import value_of
from balloon_warp.scene import Balloon, Scene, bundled_scenes, load_scene
from balloon_warp.studio.page import drawings
from balloon_warp.studio.page.layers import LAYERS, Layers
from balloon_warp.studio.page.playground import MATERIALS, Playground, Touch, made_of, material_of
from balloon_warp.studio.page.session import Picture, Session


@dataclass(frozen=True)
class Value:
    """A slider for a parameter of the world, or of all balloons alike."""

    row: Parameter
    label: str
    least_reach: float
    """Least range, where the scene's own value is 0 or small"""
    signed: bool = False

    @property
    def path(self) -> str:
        """Path in the scene."""
        return self.row.path if self.row.of == "world" else f"balloon.{self.row.path}"

    def read(self, scene: Scene) -> float:
        """Return the current value, that of the first balloon."""
        return float(value_of(scene if self.row.of == "world" else scene.balloon[0], self.row))


VALUES = (
    Value(PARAMETERS["gravity"], "gravity [m/s²]", 20.0, signed=True),
    Value(PARAMETERS["helium"], "lift [m/s^2]", 30.0),
    Value(PARAMETERS["damping"], "damping [N s/m]", 1.0),
    Value(PARAMETERS["structural"], "structural springs", 1.0),
    Value(PARAMETERS["shear"], "shear springs", 1.0),
    Value(PARAMETERS["flexion"], "flexion springs", 1.0),
)
"""Values that every scene has"""
SPRINGS = ("structural", "shear", "flexion")
TABLES = {
    "Contacts": ("touch", "ground", "friction"),
    "Material": ("material",),
    "Air and water": ("atmosphere", "water", "drag_coefficient", "face_drag", "face_friction"),
    "Gas": ("inflation", "neck"),
}
"""Folders of the panel, and the tables, or single values, of a scene or balloon in them"""
MUCH = {"m": 0.1, "N/m": 10.0, "m^2": 1e-5, "Pa s": 1e4}
"""Least range of a slider by unit, where 1 is out of proportion"""
SET_ONCE = ("fill_", "molar_mass", "neck_opens", "neck_closes", "gust_seed", "most_stretch", "wrinkling", "air_lapse")
"""Prefixes of parameters that set the start of a scene, or that are no amounts"""
WIDER = 5.0
"""Range of a slider over the default, where the scene has no value"""


def of_tables() -> dict[str, list[Value]]:
    """Return sliders for the numbers in tables that not every scene has, by their folders, from the rows."""
    return {
        folder: [
            _value_of_row(row)
            for row in PARAMETERS.values()
            if row.path.partition(".")[0] in tables and row.size == 1 and not row.name.startswith(SET_ONCE)
        ]
        for folder, tables in TABLES.items()
    }


IN_WIND = ("wind_shear", "wind_height", "roughness", "gusts", "gust_length")
"""Suffixes of parameters without effect in calm air"""
OF_AIR = ("air_pressure", "air_temperature")
"""Parameters without effect on balloons without drag or gas"""


def does_something(scene: Scene, row: Parameter) -> bool:
    """Return whether a parameter of a scene, or of its first balloon, exists, and has an effect at present."""
    if not stands_in(scene, row):
        return False
    if row.name in SPRINGS:
        material = scene.balloon[0].material
        return not material.is_membrane or row.name in material.springs
    if row.name.endswith(IN_WIND):
        gusty = scene.atmosphere.gusts > 0.0 or not row.name.endswith("gust_length")
        return any(scene.atmosphere.wind) and gusty
    if row.name in OF_AIR:
        return any(_feels_air(balloon) for balloon in scene.balloon)
    return True


def _feels_air(balloon: Balloon) -> bool:
    drag = balloon.drag_coefficient, balloon.face_drag, balloon.face_friction
    return balloon.inflation.kind == "gas" or any(drag)


def stands_in(scene: Scene, row: Parameter) -> bool:
    """Return whether a scene, or its first balloon, has a row's table, a use for it, and a number in it.

    A value of "auto" follows from others, and has no slider.
    """
    table: Any = scene if row.of == "world" else scene.balloon[0]
    for name in row.path.split(".")[:-1]:
        table = getattr(table, name, None)
        if table is None:
            return False
    if value_of(scene if row.of == "world" else scene.balloon[0], row) < row.least:
        return False
    if row.path.startswith("inflation."):
        return scene.balloon[0].inflation.kind == "gas"
    if row.path.startswith("material."):
        return table.is_membrane and row.path.rpartition(".")[2] in table.own_fields
    return True


def _value_of_row(row: Parameter) -> Value:
    name = re.sub(
        r"[._]", " ", row.path.replace("atmosphere.", "air ").removeprefix("inflation.").removeprefix("material.")
    )
    return Value(row, name if row.unit == "1" else f"{name} [{row.unit}]", _reach(row), signed=-FAR < row.least < 0.0)


def _reach(row: Parameter) -> float:
    """Return the range of a slider, where the scene has no value or a small one."""
    return row.most if row.most < FAR else max(WIDER * abs(row.default), MUCH.get(row.unit, 1.0))


def values_of(laws: Sequence[Law]) -> Iterator[Value]:
    """Return the sliders for the parameters of laws of one's own; vectors have none."""
    for row in dict.fromkeys(row for law in laws for row in law.parameters):
        if row.size == 1 and row.name not in PARAMETERS:
            yield Value(row, f"{row.name} [{row.unit}]", _reach(row), signed=row.least < 0.0)


FACTOR = 10.0
"""Range of a slider over the scene's value, upward and downward"""
END = 1.0
"""End of a slider to the right, and to the left with the other sign: the scene's value is at 0"""
DIGITS = "{:.4g}"


class Dial:
    """Adds a box for a number to the panel, and a slider below it.

    Args:
        gui: of the page.
        value: that it sets.
        act: called with a number that somebody sets, within the dial's range.
        tell: called with a sentence where a typed number is beyond that.
    """

    def __init__(
        self, gui: viser.GuiApi, value: Value, act: Callable[[float], None], tell: Callable[[str], None]
    ) -> None:
        self.value, self._act, self._tell = value, act, tell
        self._base, self._least, self._most, self._by_factors = 1.0, 0.0, 1.0, True
        self.box = gui.add_number(value.label, 1.0, step=1e-6, hint=value.row.meaning or None)
        self.slider = gui.add_slider("", -END, END, END / 100.0, 0.0, marks=(-END, END))
        on_change(self.box, self._type)
        on_change(self.slider, self._slide)

    @property
    def visible(self) -> bool:
        """Return whether the dial is visible."""
        return self.box.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible != self.box.visible:
            self.box.visible = self.slider.visible = visible

    def reach(self, number: float) -> None:
        """Set the range around a scene's value.

        By factors of it down to a tenth, and then 0; or evenly from 0, where it is 0 or may have either sign.
        """
        row = self.value.row
        self._base, self._by_factors = number, number > 0.0 and not self.value.signed
        if self._by_factors:
            self._most = min(FACTOR * number, row.most)
            self._least = 0.0 if row.least <= 0.0 else max(number / FACTOR, row.least)
        else:
            self._most = min(max(WIDER * abs(number), self.value.least_reach), row.most)
            self._least = max(-self._most, row.least) if self.value.signed else 0.0
        ends = ((-END, self._least), (END, self._most))
        self.slider._marks = tuple(GuiSliderMark(value=place, label=DIGITS.format(end)) for place, end in ends)

    def put(self, number: float) -> None:
        """Show a number."""
        self.box.value = float(DIGITS.format(number))
        self.slider.value = self._place(number)

    def _type(self, number: float) -> None:
        within = clamped(self.value.label, number, self._least, self._most, self._tell)
        if within != number:
            self.box.value = within
        self.slider.value = self._place(within)
        self._act(within)

    def _slide(self, place: float) -> None:
        number = float(DIGITS.format(self._number(place)))
        self.box.value = number
        self._act(number)

    def _number(self, place: float) -> float:
        if place >= END:
            return self._most
        if place <= -END:
            return self._least
        if not self._by_factors:
            return self._least + (self._most - self._least) * (place + END) / (2.0 * END)
        return min(max(self._base * FACTOR ** (place / END), self._least), self._most)

    def _place(self, number: float) -> float:
        if not self._by_factors:
            return END * (2.0 * (number - self._least) / (self._most - self._least) - 1.0)
        return END * min(max(math.log(max(number, 1e-30) / self._base, FACTOR), -1.0), 1.0)


def on_change(handle: Any, act: Callable[[Any], None]) -> None:
    """Act on values set in a page, not on values that the server sets.

    It acts at once, on the thread that received the value: later the server might have set another.
    """

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            act(handle.value)


def on_slide(slider: Any, act: Callable[[float], None], tell: Callable[[str], None]) -> None:
    """Act on slider values as `on_change`, with typed values kept within the slider's ends."""

    def heard(number: float) -> None:
        within = clamped(slider.label, number, slider.min, slider.max, tell)
        if within != number:
            slider.value = within
        act(within)

    on_change(slider, heard)


def clamped(label: str, number: float, least: float, most: float, tell: Callable[[str], None]) -> float:
    """Return a number, or the end of its range that it is beyond, which is then reported."""
    within = min(max(number, least), most)
    if within != number:
        end = "maximum" if number > most else "minimum"
        tell(f"{label}: {DIGITS.format(within)} is the {end} here (got {DIGITS.format(number)})")
    return within


KEYS = (
    ("drag a balloon", "pulls it"),
    ("click", "throws a sphere there"),
    ("I K", "inflates, deflates"),
    ("space", "pauses, resumes"),
    ("N", "steps one frame"),
    ("R", "resets to the start, the camera, too"),
    ("C", "cuts the strings"),
    ("F", "follows the balloon, or stops"),
    ("?", "shows or hides the keys"),
)
"""Actions of a user and their effects"""
COMPILING = "compiling kernels; they are cached for the next time"
"""Reason why time stops for some seconds"""
KEPT_UP = 0.95
"""Fraction of the requested speed that counts as kept"""
KEYS_BUTTON = '<div class="bw-keys"><button class="bw-keys-button" title="keys">?</button></div>'
"""Button at the end of the status line, which is rewritten while a user presses it"""
NEARLY_ALL = 0.9
"""Fraction of a frame's time from which on simulation alone limits the speed"""


def status_line(picture: Picture, busy_seconds: float = 0.0) -> str:
    """Return the time and pace, in one line however long they are.

    Args:
        busy_seconds: how long a request takes by now, if it takes long.
    """
    recorded = f" · ● {picture.recorded_seconds:.1f} s" if picture.recorded_seconds is not None else ""
    pace, why = (f"getting ready: {busy_seconds:.1f} s", COMPILING) if busy_seconds else _pace(picture)
    said = f' data-busy="{escape(pace)}"' if busy_seconds else ""
    said += " data-moves" if picture.frame.number > 0 or not picture.running else ""  # page_files/wait.js reads both
    return (
        f'<div class="bw-status"{said} title="{escape(why)}">'
        f"<span><b>{picture.seconds:.2f} s</b> · {escape(pace)}{recorded}</span></div>"
    )


def row_of(count: int, large: bool = False) -> str:
    """Return the markup that puts a number of following buttons side by side; see page_files/page.css."""
    return f'<div class="bw-row-{count}{" bw-large" if large else ""}"></div>'


def trouble_line(picture: Picture) -> str:
    """Return the error; more of it is shown where a pointer rests."""
    return f'<div class="bw-trouble" role="alert" title="{escape(picture.why)}">{escape(picture.trouble)}</div>'


def _pace(picture: Picture) -> tuple[str, str]:
    """Return the speed of time, and why it is slower than requested."""
    if not picture.running:
        return "paused", ""
    if picture.rate == 0.0:
        return "…", ""
    pace = f"{picture.rate:.2f}x real time"
    if picture.rate >= KEPT_UP * picture.speed:
        return ("real time" if picture.speed == 1.0 else pace), ""
    taken, due = 1000.0 * picture.step_seconds, 1000.0 * picture.model.frame_seconds / picture.speed
    if taken >= NEARLY_ALL * due:
        return pace, f"slower than requested: a frame takes {taken:.0f} ms, and one is due every {due:.0f} ms"
    return pace, f"slower than requested: this machine is busy; simulating a frame takes {taken:.0f} ms"


def details(picture: Picture) -> str:
    """Return the sizes of the model, its schedule and its device."""
    model = picture.model
    return (
        f'<div class="bw-details">{model.particle_count:,} particles, {model.spring_count:,} springs, '
        f"{model.substeps} substeps a frame, {escape(picture.schedule)} on {escape(str(model.device))}</div>"
    )


def key_sheet() -> str:
    """Return the keys, as a table."""
    rows = "".join(f"<tr><th>{escape(key)}</th><td>{escape(does)}</td></tr>" for key, does in KEYS)
    return f'<template id="bw-keys"><table>{rows}</table></template>'


def strain_legend() -> str:
    """Return the legend of the strain bands: length over rest length."""
    bounds = ["", *(f"{bound:g}" for bound in drawings.STRAIN_BOUNDS)]
    cells = "".join(
        f'<div style="flex:1;border-top:0.6em solid rgb{color};padding-right:0.2em">{bound}</div>'
        for color, bound in zip(drawings.STRAIN, bounds, strict=True)
    )
    title = '<div style="font-size:0.8em;margin:0 1em">stretch: length / rest length</div>'
    return title + f'<div style="display:flex;font-size:0.7em;margin:0 1.2em 0.6em">{cells}</div>'


SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
NUDGE = 0.04
"""Fraction of the inflation slider's range that a key or a press moves it by"""
HELD_NUDGE = 0.01
"""Fraction of the inflation slider's range that a held button moves it by every tenth of a second"""
INFLATIONS = {"k_normal": "inflation (k_normal)", "pressure": "pressure [Pa]", "pump": "pump [mol/s]"}


class MainControls:
    """Main controls of the panel: inflation, time, scene, and the material and color of balloons.

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
        if picture.executed == self._session.asked and (
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
        self.color.value = drawings.balloon_color(scene, 0, picture.model.shapes[0].mesh)

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
        self.color = gui.add_rgb("color", drawings.BRAND, hint="of all balloons")
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
        linear = drawings.linear(color)
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


SECONDS = 10.0
CURVES = {
    "volume": ("volume [l]", "#c82824", 1000.0),
    "pressure": ("pressure [Pa]", "#1e50dc", 1.0),
    "stretch": ("largest stretch", "#14963c", 1.0),
    "frame": ("frame time [ms]", "#e08a10", 1000.0),
}
"""Label, color, and factor on the measure"""
LEAST_SPAN = 0.02
"""Least range of a plot over the largest value, so that small changes are not magnified"""
STEPS = 0.02
"""Least difference between ticks: the plots have three decimals and about five ticks"""


class Plots:
    """A plot for each measure."""

    def __init__(self, server: viser.ViserServer):
        self._samples: deque[tuple[float, ...]] = deque()
        self._load = 0
        self._plots = {
            name: server.gui.add_uplot(
                data=(np.array([0.0, 1.0]), np.array([0.0, 0.0]), np.array([-1.0, 1.0])),
                # the last is not seen: the axis reaches as far as it does (to set a range makes the plot anew)
                series=(
                    uplot.Series(label="t [s]"),
                    uplot.Series(label=label, stroke=color, width=2),
                    uplot.Series(stroke="transparent", width=0),
                ),
                scales={"x": uplot.Scale(time=False)},
                legend=uplot.Legend(show=False),
                title=label,
                height=120,
            )
            for name, (label, color, _) in CURVES.items()
        }

    def add(self, picture: Picture, measures: dict[str, float]) -> None:
        """Add a sample of each measure; time that ran backward restarts the curves."""
        if picture.load != self._load or (self._samples and picture.seconds < self._samples[-1][0]):
            self._load = picture.load
            self._samples.clear()
        measured = {**measures, "frame": picture.step_seconds}
        sample = {name: factor * measured[name] for name, (_, _, factor) in CURVES.items()}
        if not self._samples or picture.seconds > self._samples[-1][0]:
            self._samples.append((picture.seconds, *(sample[name] for name in CURVES)))
        while self._samples[-1][0] - self._samples[0][0] > SECONDS:
            self._samples.popleft()
        if len(self._samples) > 1:
            times, *curves = np.array(self._samples).T
            for plot, curve in zip(self._plots.values(), curves, strict=True):
                plot.data = (times, curve, np.linspace(*span_of(curve), len(curve)))


def span_of(curve: NDArray[np.floating]) -> tuple[float, float]:
    """Return the range of a plot of values, such that its ticks differ."""
    low, high = float(curve.min()), float(curve.max())
    least = max(LEAST_SPAN * max(abs(low), abs(high)), STEPS)
    middle, half = (low + high) / 2, max(0.55 * (high - low), least / 2)
    return middle - half, middle + half


CHOICES = {
    field: {name.replace("_", " "): name for name in get_args(Scene.model_fields[field].annotation)}
    for field in ("solver", "normals", "correction", "contact")
}
"""Choices of scene fields by their labels in the panel"""


class Controls:
    """Adds the panel to a page.

    Args:
        server: of the page.
        session: that the panel steers.
        layers: of the view.
        look: turns a window's camera to the balloon, and lets it follow or stay.
        home: brings a window's camera back to where it was at first.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        layers: Layers,
        look: Callable[[viser.ClientHandle], None],
        home: Callable[[viser.ClientHandle], None],
    ):
        self.server, self.session, self.layers = server, session, layers
        self._bound: tuple[int, int] = (0, 0)
        self._seen: Scene | None = None
        self._ways: dict[str, Any] = {}
        gui = server.gui
        gui.add_html(KEYS_BUTTON)
        self.status = gui.add_html("")
        self._add_trouble()
        self.main_controls = MainControls(server, session, look, home)
        with gui.add_folder("Click"):
            self._add_click()
        self._folders: list[tuple[Any, list[Dial]]] = []
        self._add_dials("Balloon", [*VALUES, *values_of(session.laws)])
        for name, values in of_tables().items():
            self._add_dials(name, values)
        with gui.add_folder("Show", expand_by_default=False):
            self._add_layers()
        with gui.add_folder("Recording", expand_by_default=False):
            self._add_recording()
        with gui.add_folder("Plots", expand_by_default=False) as self.plots_folder:
            pass
        with gui.add_folder("Advanced", expand_by_default=False):
            self._add_advanced()
        self.details = gui.add_html("")

    def follow(self, picture: Picture, busy_seconds: float = 0.0) -> None:
        """Bring the panel up to date with a picture.

        Args:
            busy_seconds: how long a request takes by now, if it takes long.
        """
        if picture.executed == self.session.asked:  # else hands are ahead of the picture, and must not be pulled back
            if self._bound != (picture.load, picture.revision):
                self._bind(picture)
            if picture.scene is not self._seen:
                self._seen = picture.scene
                self._show_what_acts(picture.scene)
        self.main_controls.follow(picture)
        self.trouble.visible = self.back.visible = bool(picture.trouble)
        self.trouble.content = trouble_line(picture) if picture.trouble else ""
        self.record.label = "Stop and save" if picture.recorded_seconds is not None else "Record"
        self._offer_files()
        self.status.content, self.details.content = status_line(picture, busy_seconds), details(picture)

    def wait(self, picture: Picture, busy_seconds: float) -> None:
        """Report that a request takes some time."""
        self.status.content = status_line(picture, busy_seconds)

    def _add_trouble(self) -> None:
        self.trouble = self.server.gui.add_html("", visible=False)
        self.back = self.server.gui.add_button("Go back", visible=False, hint="to the shape shown")
        self.back.on_click(lambda _: self.session.go_back())

    def _add_click(self) -> None:
        gui = self.server.gui
        gui.add_markdown("Drag the balloon to pull it, or beside it to orbit the view.")
        self.tool = gui.add_dropdown("click", ("throws a sphere", "ties a string", "does nothing"))
        self.mass = self._plain_slider("mass [kg]", (0.1, 50.0, 0.1, 2.0), "of a sphere")
        self.cut = gui.add_button("Cut all strings", color="gray", hint="key C")
        self.cut.on_click(lambda _: self._cut())
        gui.add_command("Cut all strings", hotkey="C").on_trigger(lambda _: self._cut())

    def _plain_slider(self, label: str, numbers: tuple[float, float, float, float], hint: str) -> Any:
        """Return a slider that has no effect before a sphere is thrown; arguments are from, to, step and start."""
        slider = self.server.gui.add_slider(label, *numbers, hint=hint)
        on_slide(slider, lambda _: None, self.session.tell)
        return slider

    def _add_dials(self, name: str, values: list[Value]) -> None:
        """Add a folder of sliders; those without effect in a scene are hidden."""
        gui = self.server.gui
        with gui.add_folder(name, expand_by_default=False) as folder:
            dials = [self._dial(value) for value in values]
            if name == "Balloon":
                hint = "pushes balloons that have drag in air"
                self.wind = gui.add_vector3("wind [m/s]", (0.0, 0.0, 0.0), step=0.1, hint=hint)
                on_change(self.wind, self._blow)
        self._folders.append((folder, dials))

    def _dial(self, value: Value) -> Dial:
        return Dial(self.server.gui, value, lambda number: self.session.set(value.path, number), self.session.tell)

    def _show_what_acts(self, scene: Scene) -> None:
        for folder, dials in self._folders:
            for dial in dials:
                dial.visible = does_something(scene, dial.value.row)
            visible = any(dial.visible for dial in dials)
            if folder.visible != visible:
                folder.visible = visible
        self.shown["contacts"].visible = scene.contacts

    def _add_layers(self) -> None:
        self.shown = {}
        for name, label in LAYERS.items():
            box = self.server.gui.add_checkbox(label, self.layers.shown[name])
            on_change(box, lambda shown, name=name: self._show(name, bool(shown)))
            self.shown[name] = box
            if name == "strain":
                self.legend = self.server.gui.add_html(strain_legend(), visible=False)

    def _add_recording(self) -> None:
        gui = self.server.gui
        gui.add_markdown("Saves an animated stage (USD), and a scene that replays it from its start.")
        self.record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD)
        self.record.on_click(lambda _: self.session.record(self.session.recording is None))
        self._offered: list[tuple[Any, int]] = []
        gui.add_html(row_of(2))
        for label, number in (("Stage", 0), ("Scene", 1)):
            button = gui.add_button(
                label, icon=viser.Icon.DOWNLOAD, color="gray", visible=False, hint="download the last recording"
            )
            button.on_click(lambda event, number=number: event.client and self._send(event.client, number))
            self._offered.append((button, number))

    def _offer_files(self) -> None:
        for button, number in self._offered:
            if button.visible != (number < len(self.session.saved)):
                button.visible = not button.visible

    def _send(self, client: viser.ClientHandle, number: int) -> None:
        """Send a file of the last recording to a window, whose browser saves it."""
        file = self.session.saved[number]
        try:
            content = file.read_bytes()
        except OSError as error:
            return self.session.tell(f"{file}: cannot be read: {error.strerror}")
        client.send_file_download(file.name, content, save_immediately=True)

    def _add_advanced(self) -> None:
        gui = self.server.gui
        for field, choices in CHOICES.items():
            way = gui.add_dropdown(field, tuple(choices))
            on_change(way, lambda name, field=field: self.session.set_method(field, CHOICES[field][name]))
            self._ways[field] = way
        self.stable = gui.add_checkbox("keep the step stable", True)
        on_change(self.stable, self._keep_stable)
        sizes = "of a thrown sphere, in sizes of the balloon"
        self.radius = self._plain_slider("radius [size]", (0.02, 0.5, 0.01, 0.12), sizes)
        self.throw_speed = self._plain_slider("speed [sizes/s]", (0.5, 30.0, 0.5, 5.0), sizes)

    def _show(self, name: str, shown: bool) -> None:
        self.layers.show(name, shown)
        self.legend.visible = self.layers.shown["strain"]
        self.session.wants_forces = self.layers.shown["forces"]

    def _cut(self) -> None:
        self.session.ask(lambda playground: playground.cut_all(), key="cut", touch=Touch.CUTS)

    def _blow(self, wind: Any) -> None:
        self.session.ask(
            lambda playground: playground.blow([float(part) for part in wind]), key="wind", touch=Touch.BLOWS
        )

    def _keep_stable(self, keep: Any) -> None:
        def change(playground: Playground) -> None:
            playground.keep_stable = bool(keep)

        self.session.ask(change, key="stable")

    def _bind(self, picture: Picture) -> None:
        """Set values and ranges to the scene's current ones."""
        scene, fresh = picture.scene, self._bound[0] != picture.load
        self.main_controls.bind(picture, fresh)
        for _, dials in self._folders:
            for dial in dials:
                number = dial.value.read(scene)
                if fresh:
                    dial.reach(number)
                dial.put(number)
        self.wind.value = scene.atmosphere.wind
        for field, choices in CHOICES.items():
            names = {choice: name for name, choice in choices.items()}
            self._ways[field].value = names[getattr(scene, field)]
        self._bound = (picture.load, picture.revision)
