"""Lines of the kernels: each is of one kind."""

from balloon_warp.benchmarks.lines import KINDS, folders, kinds_of

TEXT = '''"""A file.

Of two functions.
"""

import math


# A comment.
@decorated
def first(
    a: int,
) -> float:
    """Return a root."""
    import cmath  # late

    # Another comment.
    return math.sqrt(a)


def second():
    return 2
'''


def test_each_line_is_of_one_kind_in_all_folders():
    found = kinds_of(TEXT)
    assert found["lines"] == len(TEXT.splitlines()) == sum(found[kind] for kind in KINDS)
    assert [found[kind] for kind in KINDS] == [2, 5, 2, 5, 2, 6]
    assert found["functions"] == 2
    found = folders()
    assert {"laws", "phases", "schedules", "adjoints"} <= found.keys()
    assert all(counts["lines"] == sum(counts[kind] for kind in KINDS) for counts in found.values())
