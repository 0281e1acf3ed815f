"""Outlines of foil balloons: closed lines of letters and drawings, and a sentence where there is none."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from drawings import drawing

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.foil.drawing import outlines_of_drawing
from balloon_warp.foil.make import foil_mesh
from balloon_warp.foil.outlines import enclosed

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
STAR = np.array([[np.sin(0.8 * np.pi * k), np.cos(0.8 * np.pi * k)] for k in range(5)])


def area(loops: list[np.ndarray], rule: str = "nonzero") -> float:
    return sum(polygon.area for polygon in enclosed(loops, rule))  # pyright: ignore[reportArgumentType]


def test_inside_is_what_lines_wind_around():
    inner = 1.0 + 0.5 * SQUARE
    assert area([SQUARE]) == area([SQUARE[::-1]]) == 16.0
    assert area([SQUARE, inner]) == 16.0
    assert area([SQUARE, inner[::-1]]) == area([SQUARE, inner], "evenodd") == 12.0
    assert area([SQUARE, SQUARE + 2.0]) == 28.0  # they overlap
    assert area([SQUARE, SQUARE + 2.0], "evenodd") == 24.0
    # a star drawn in one line: twice around its middle, a pentagon
    assert len(enclosed([STAR], "evenodd")) == 5
    (star,) = enclosed([STAR])
    assert star.area > area([STAR], "evenodd") + 0.3


def test_crumbs_and_lines_are_left_out():
    assert area([SQUARE, SQUARE[:2], 1e-4 * SQUARE + 9.0]) == 16.0
    assert enclosed([SQUARE[:2]]) == enclosed([]) == []


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ('<rect width="40" height="30"/>', 1200.0),
        ('<circle cx="50" cy="50" r="10"/>', 100.0 * np.pi),
        ('<ellipse cx="50" cy="50" rx="10" ry="20"/>', 200.0 * np.pi),
        ('<polygon points="0,0 10,0 0,10"/>', 50.0),
        ('<path d="M0 0h10v10h-10z"/><path d="M5 5h10v10h-10z"/>', 175.0),
        ('<path d="M0 0h10v10h-10zM2 2h5v5h-5z"/>', 100.0),
        ('<path d="M0 0h10v10h-10zM2 2v5h5v-5z"/>', 75.0),
        ('<path fill-rule="evenodd" d="M0 0h10v10h-10zM2 2h5v5h-5z"/>', 75.0),
        ('<g style="fill-rule:evenodd"><path d="M0 0h10v10h-10zM2 2h5v5h-5z"/></g>', 75.0),
        ('<path d="M0 0L10 0L10 10L0 0"/><path d="M50 50L80 50L80 80L60 90"/>', 50.0),
        ('<g transform="scale(2)"><rect width="5" height="5" transform="rotate(30)"/></g>', 100.0),
        ('<rect width="5" height="5" fill="none" stroke="red"/>', 25.0),
    ],
)
def test_drawings_are_read(tmp_path: Path, content: str, expected: float):
    """Areas of drawings are exact up to a circle's chords, 0.01% with 32 lines a quarter, and an SVG file's unit."""
    found = sum(outline.area for outline in outlines_of_drawing(drawing(tmp_path, content, 'width="100" height="100"')))
    assert found == pytest.approx(expected, rel=1e-3)


BAD = {
    "": "text: has no visible character",
    "  \t": "text: has no visible character",
    "\u200b": "text: ",
    "漢": "text: the font DejaVu Sans has no '漢'; expected another --font",
}


@pytest.mark.parametrize("text", BAD)
def test_text_without_outlines_gets_one_sentence(text: str):
    with pytest.raises(InputError, match="^" + re.escape(BAD[text])) as caught:
        foil_mesh(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"font": "No Such Family"}, "--font No Such Family: no such font family"),
        ({"font": "missing.ttf"}, "--font missing.ttf: no such file"),
        ({"font": "broken.ttf"}, "--font broken.ttf: cannot be read as a font"),
        ({"height": 0.0}, "height: must be a number greater than 0 (got 0.0)"),
        ({"height": float("nan")}, "height: must be"),
        ({"edge": -1.0}, "edge: must be a number greater than 0 (got -1.0)"),
        ({"edge": 1e-6}, "edge: 1e-06 m makes "),
    ],
)
def test_options_that_cannot_be_get_one_sentence(options: dict, sentence: str, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("broken.ttf").write_bytes(b"no font")
    with pytest.raises(InputError, match="^" + re.escape(sentence)) as caught:
        foil_mesh("L", **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "is no SVG drawing"),
        ("<svg", "is no SVG drawing"),
        ('<svg xmlns="http://www.w3.org/2000/svg"/>', "has no closed path with an area; expected one"),
        ('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0L9 9L5 0"/></svg>', "has no closed path"),
        ('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0L9 9z"/></svg>', "has no closed path"),
        ('<svg xmlns="http://www.w3.org/2000/svg"><text x="9">A</text></svg>', "has no closed path"),
        ('<svg xmlns="http://www.w3.org/2000/svg"><rect width="1e999" height="1"/></svg>', ""),
        ('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0L9 9 garbage"/></svg>', ""),
        ('<svg xmlns="http://www.w3.org/2000/svg"><rect width="no" height="1"/></svg>', ""),
        (
            '<svg xmlns="http://www.w3.org/2000/svg"><path d="C10 60 0 20 30 15z"/></svg>',
            "is no SVG drawing, or a damaged one",
        ),
        (
            '<svgs xmlns="http://www.w3.org/2000/svg"><path d="M0 0h9v9z"/></svgs>',
            "is no SVG drawing, or a damaged one",
        ),
        ("\0\1\2", "is no SVG drawing"),
    ],
)
def test_drawings_without_outlines_get_one_sentence(content: str, reason: str, tmp_path: Path):
    path = tmp_path / "drawing.svg"
    path.write_text(content)
    with pytest.raises(InputError, match="^" + re.escape(f"{path}: {reason}")) as caught:
        foil_mesh(path)
    assert "\n" not in str(caught.value)


def test_a_drawing_that_is_not_there_gets_one_sentence(tmp_path: Path):
    with pytest.raises(InputError, match=r"missing\.svg: cannot be read: No such file or directory$"):
        foil_mesh(tmp_path / "missing.svg")
    (tmp_path / "folder.svg").mkdir()
    with pytest.raises(InputError, match=r"folder\.svg: cannot be read: Is a directory$"):
        foil_mesh(tmp_path / "folder.svg")


@pytest.mark.parametrize("package", ["shapely", "matplotlib"])
def test_without_the_extra_it_is_named(package: str, monkeypatch: pytest.MonkeyPatch):
    for module in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=rf"^foil balloons need {package}: pip install 'balloon-warp\[foil\]'$"):
        foil_mesh("L")
