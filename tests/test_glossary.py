"""Terms of docs/GLOSSARY.md: each is in the code, in the file named as its home."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "GLOSSARY.md"
ROWS = re.findall(
    r"^\| ([a-z][^|]*?) \| ([^|]+) \| ([^|]*\]\([^|]*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
)


def stem(word: str) -> str:
    """Return the common stem of a word and its other forms."""
    return re.sub(r"(es|e|s|ed|y)$", "", word)


def test_there_is_a_glossary():
    assert len(ROWS) > 30
    words = [word for row in ROWS for word in row[0].split(", ")]
    assert len(words) == len(set(words))


@pytest.mark.parametrize(("words", "_meaning", "home"), ROWS, ids=[row[0] for row in ROWS])
def test_a_word_stands_where_it_is_at_home(words: str, _meaning: str, home: str):
    files = [(PAGE.parent / link).resolve() for link in re.findall(r"\]\(([^)]+)\)", home)]
    said = " ".join(f"{file.stem} {file.read_text(encoding='utf-8')}" for file in files).lower()
    said = re.sub(r"[\s_-]+", " ", said)
    for word in words.split(", "):
        assert all(stem(part) in said for part in re.split("[ -]", word.lower())), word
