"""Mutants of the source, and the tests that are run on them."""

from pathlib import Path

import pytest

from balloon_warp.benchmarks import mutation
from balloon_warp.benchmarks.mutant_tests import Verdict, judge_all, trace
from balloon_warp.benchmarks.mutants import Stratum, all_mutants, draw, mutants_of, signatures_of
from balloon_warp.benchmarks.traced_tests import Traced

ROOT = Path(__file__).parent.parent


def mutants(text: str) -> dict[str, set[str]]:
    """Return the files that a file may become, by operators."""
    found: dict[str, set[str]] = {}
    for each in mutants_of("toy", "toy.py", text.encode(), signatures_of([text.encode()])):
        found.setdefault(each.operator, set()).add(each.source(text.encode()).decode())
    return found


@pytest.mark.parametrize(
    ("operator", "before", "after"),
    [
        ("another sign", "x = a + (b)", ["x = a - (b)"]),
        ("another sign", "x = -a", ["x = a"]),
        ("another sign", "x += f(\n    a)", ["x -= f(\n    a)"]),
        ("another sign", "x = 'a' + b", []),
        ("times or divided by", "x = (a) * (b + c)", ["x = (a) / (b + c)"]),
        ("times or divided by", "x = a / b", ["x = a * b"]),
        ("times or divided by", "x = a ** b", []),
        ("times or divided by", "x = there.side * a", []),
        ("a comparison turned", "x = a <= b", ["x = a > b"]),
        ("a comparison turned", "x = f(a < b) == 'name'", ["x = f(a >= b) == 'name'", "x = f(a < b) != 'name'"]),
        ("a comparison turned", "x = a is b", []),
        ("another constant", "x = 0.5", ["x = 0.6"]),
        ("another constant", "x = max(a, 1.0e-20)", []),
        ("another constant", "NEAR = wp.constant(1.0e-4)\nMOST_LOOKS, LOOKS = wp.constant(8), wp.constant(8)",
         ["NEAR = wp.constant(1.0e-4)\nMOST_LOOKS, LOOKS = wp.constant(8), wp.constant(9)"]),
        ("another constant", "x = 3 * a", ["x = 4 * a"]),
        ("another index", "x = a[i, 2]", ["x = a[i, 1]"]),
        ("arguments exchanged", "x = wp.cross(a, f(b))", ["x = wp.cross(f(b), a)"]),
        ("arguments exchanged", "x = np.where(c, a, b)", ["x = np.where(c, b, a)"]),
        (
            "arguments exchanged",
            "def f(a: int, b: float, c: float): ...\nf(u, v, w)",
            ["def f(a: int, b: float, c: float): ...\nf(u, w, v)"],
        ),
        ("a term dropped", "x = (a if b else c) + d + e", ["x = (a if b else c) + d", "x = (a if b else c) + e"]),
        ("minimum or maximum", "x = np.maximum(a, b)", ["x = np.minimum(a, b)"]),
        ("minimum or maximum", "x = (a + b).max()", ["x = (a + b).min()"]),
        ("a condition negated", "f(when=lambda n: n.gas or n.air)", ["f(when=lambda n: not (n.gas or n.air))"]),
        ("a neighbor returned", "def f(): return a, b", ["def f(): return b, b", "def f(): return a, a"]),
    ],
)  # fmt: skip
def test_an_operator_changes_one_place(operator: str, before: str, after: list[str]) -> None:
    assert mutants(before).get(operator, set()) == set(after)


@pytest.mark.parametrize(
    "text",
    [
        '"""1.0 + 2.0"""',
        "# 1.0 + 2.0",
        "def f(a: Callable[[1], 2]) -> g[0]: ...",
        "raise ValueError(a + 1.0)",
        "x = f'{1.0 + a}'",
        "x = 'a number' if a == 1 else b",
    ],
)
def test_what_no_test_should_notice_stays(text: str) -> None:
    assert not mutants(text)


def test_a_seed_says_which_are_drawn() -> None:
    first, again, other = (draw(ROOT, mutation.STRATA, 60, seed) for seed in (1, 1, 2))
    assert first == again
    assert {each.key for each in first} != {each.key for each in other}


def test_a_pattern_without_files_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"stratum laws: no file is gone/\*\.py"):
        draw(tmp_path, (Stratum("laws", 1.0, ("gone/*.py",)),), 1, 0)


def test_what_is_answered_is_still_there() -> None:
    keys = {each.key for of_stratum in all_mutants(ROOT, mutation.STRATA).values() for each in of_stratum}
    assert set(mutation.EQUIVALENT) <= keys


def test_an_answered_survivor_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    verdicts = [Verdict(name, "toy.py:1", "", "", "", found, "", 1.0, "") for name, found in
                (("a", True), ("b", True), ("c", False), ("d", False))]  # fmt: skip
    assert mutation.share_found(verdicts) == 0.5
    monkeypatch.setattr(mutation, "EQUIVALENT", {"c": "a guard that never holds"})
    assert mutation.share_found(verdicts) == pytest.approx(2 / 3)
    assert "nothing: a guard that never holds" in mutation.table(verdicts)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--count", "0"], "--count, --processes and --seconds must be at least 1"),
        (["--write", "gone/mutants.json"], "gone/mutants.json: its folder is not there"),
    ],
)
def test_bad_arguments_get_a_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        mutation.main(arguments)
    assert capsys.readouterr().err.splitlines()[-1].endswith(f"error: {sentence}")


LAW = """
def force(k, d):
    return k * d

def power(a, b):
    return a + b

def odd(a, b):
    return a - b

def count(most):
    number = 0
    while number < most:
        number += 1
    return number

PRESSURE = 1.0
"""
TESTS = """
import os
from pathlib import Path

from toy.law import PRESSURE, count, force, odd, power

assert PRESSURE == 1.0

def test_force():
    assert force(2.0, 3.0) == 6.0

def test_power():
    power(1.0, 2.0)

def test_odd():
    odd(1.0, 2.0)
    seen = Path(os.environ["TOY_SEEN"])
    assert not seen.exists()
    seen.touch()

def test_count():
    assert count(2) == 2
"""
TRACED = [Traced(f"tests/test_toy.py::test_{name}", 0.1, {"toy/law.py": [line]})
          for name, line in (("force", 2), ("power", 5), ("odd", 8), ("count", 11))]  # fmt: skip


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a package of one file with a file of tests. One of them passes once alone."""
    for path, text in (("toy/law.py", LAW), ("tests/test_toy.py", TESTS)):
        (tmp_path / "tree" / path).parent.mkdir(parents=True)
        (tmp_path / "tree" / path).write_text(text)
    monkeypatch.setenv("TOY_SEEN", str(tmp_path / "seen"))
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # they take longer than the toy
    return tmp_path / "tree"


def verdicts_on(toy: Path, new: set[str], seconds: float) -> dict[str, tuple[bool, str]]:
    """Return whether mutants are found, and how, by the code that they put into the toy."""
    of_toy = all_mutants(toy, (Stratum("toy", 1.0, ("toy/*.py",)),))["toy"]
    chosen = [each for each in of_toy if each.new in new]
    return {each.new: (each.found, each.by) for each in judge_all(toy, chosen, TRACED, 2, seconds)}


@pytest.mark.full
def test_what_tests_execute_is_traced(toy: Path) -> None:
    found, expected = ({each.test: each.functions["toy/law.py"] for each in some} for some in (trace(toy, 1), TRACED))
    assert found == expected


@pytest.mark.full
def test_a_mutant_is_found_survives_hangs_or_is_found_by_chance(toy: Path, tmp_path: Path) -> None:
    """A test that looks at a function's value finds its mutants; one that fails without them, too, does not."""
    (tmp_path / "seen").touch()
    assert verdicts_on(toy, {"k / d", "a - b", "a + b", "number -= 1", "0.9"}, 10.0) == {
        "k / d": (True, "tests/test_toy.py::test_force"),
        "a - b": (False, "1 of 1 tests pass"),
        "a + b": (False, "tests/test_toy.py::test_odd fails without it, too"),
        "number -= 1": (True, "hangs in tests/test_toy.py::test_count"),
        "0.9": (True, "tests/test_toy.py"),  # which cannot be imported
    }
    assert (toy / "toy" / "law.py").read_text() == LAW
