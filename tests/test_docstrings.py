"""Docstrings: the first sentence stands alone, and begins with the field's noun or a verb."""

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = ("balloon_warp", "kernels", "scenes", "benchmarks", "docs", "tests")
OPENING = re.compile(
    r"^(Of|What|Whatever|Where|Wherever|Who|Whose|Which|Whichever|Those|These|They|Their|Them|It|Its|This|That"
    r"|The same|Same|Such|How|However|By|If|When|Whether|From|For|In|On|At|With|Within|Without|As|To|And|But|Or|Nor"
    r"|So|Not|All|One|Once|Like|Over|Then|Here|There)\b"
)
"""beginnings of half a sentence: a preposition, a conjunction, or a pronoun that leads nowhere"""
POINTING = re.compile(
    r"^\w+ (down |in |out )?(of |all of |all that |what |where |whether |how |if |that )?"
    r"(it|its|they|them|those|these|this|ones|such)\b(?! itself)"
)
"""a verb whose object is a pronoun: "Write it down." """


def docstrings(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield each docstring with its place."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(ROOT)}:{node.body[0].lineno}", text


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_begin_with_a_noun_or_a_verb(folder: str):
    found = list(docstrings(ROOT / folder))
    assert len(found) > 10
    wrong = [f"{place}: {text.splitlines()[0]}" for place, text in found if OPENING.match(text) or POINTING.match(text)]
    assert wrong == []


def meanings(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the meaning that stands below each field and constant, with its place."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for each, below in pairwise(node.body if isinstance(node, (ast.Module, ast.ClassDef)) else []):
                is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
                if isinstance(each, (ast.Assign, ast.AnnAssign)) and is_text and isinstance(below.value.value, str):
                    yield f"{path.relative_to(ROOT)}:{below.lineno}", below.value.value


@pytest.mark.parametrize("folder", ["balloon_warp", "kernels"])
def test_meanings_of_fields_begin_with_a_noun(folder: str):
    found = [(place, text) for place, text in meanings(ROOT / folder) if not text.startswith("Whether ")]
    assert len(found) > 500
    assert [f"{place}: {text}" for place, text in found if OPENING.match(text)] == []


@pytest.mark.parametrize(
    "text", ["Of the box [m].", "The same of smaller faces.", "Where one looks from.", "All of them, loop by loop."]
)
def test_half_a_sentence_is_found(text: str):
    assert OPENING.match(text)


@pytest.mark.parametrize("text", ["Write it down.", "Return whether it is visible.", "Forget them."])
def test_a_pronoun_in_place_of_a_noun_is_found(text: str):
    assert POINTING.match(text)


@pytest.mark.parametrize("text", ["Return the points.", "Offset of a spring [m].", "Oneness of a thing."])
def test_a_whole_sentence_is_left_alone(text: str):
    assert not OPENING.match(text)
    assert not POINTING.match(text)
