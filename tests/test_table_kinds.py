"""Table of a batch as CSV or Parquet: the same numbers, and the manifest names the kind."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from batches import OFTEN
from stopped_batch import scene, stop_after

from balloon_warp import InputError, MissingExtraError, run_batch
from balloon_warp.outputs import table, table_parquet

VARY = {"gravity": [1.0, 5.0, 9.0], "balloon.inflation.k_normal": [0.2, 9e11, 0.4]}
"""world 1 blows up"""

pytest.importorskip("pyarrow", reason="needs the extra `data`")


@pytest.mark.full
def test_parquet_has_the_numbers_of_the_npz(tmp_path):
    run_batch(scene(), tmp_path, 3, VARY, device="cpu", table="parquet")
    found = pd.read_parquet(tmp_path / "table.parquet")
    with np.load(tmp_path / "table.npz") as columns:
        assert list(found) == list(columns)
        for name in columns:
            assert found[name].dtype == columns[name].dtype
            np.testing.assert_array_equal(found[name], columns[name])
    said = json.loads((tmp_path / "manifest.json").read_text())
    assert said["table"] == "parquet"
    assert {"table.npz", "table.parquet"} <= said["outputs"].keys()
    assert not (tmp_path / "table.csv").exists()


def test_a_batch_that_was_stopped_goes_on_to_the_same_parquet(tmp_path, monkeypatch):
    """A resumed batch writes the same Parquet, with a row group for each frame; so does one that replaces a .csv."""
    monkeypatch.setattr(table_parquet, "ROWS", 1)
    run_batch(scene(), tmp_path / "whole", 3, VARY, device="cpu", table="parquet")
    run_batch(scene(), tmp_path / "parts", 3, VARY, device="cpu")
    how = {"device": "cpu", "table": "parquet", "checkpoint_seconds": OFTEN}
    with pytest.raises(RuntimeError):
        run_batch(scene(), tmp_path / "parts", 3, VARY, **how, on_frame=stop_after(3))
    assert (tmp_path / "parts" / "table.csv").exists()
    run_batch(scene(), tmp_path / "parts", 3, VARY, **how, resume=True)
    parts, whole = (tmp_path / name / "table.parquet" for name in ("parts", "whole"))
    assert parts.read_bytes() == whole.read_bytes()
    assert not (tmp_path / "parts" / "table.csv").exists()


def test_what_is_replaced_is_written_again(tmp_path):
    columns = (tmp_path, 3, 60.0, {"mesh": np.array(["a", "b"])}, ["height"], 2, "parquet")
    with table.TableWriter(*columns) as rows:
        for _ in range(3):
            rows.write_frame()
        rows.values[:] = 7.0
        rows.write_again()
    found = pd.read_parquet(tmp_path / "table.parquet")
    assert found["height"].tolist() == [7.0] * 6
    assert found["mesh"].tolist() == ["a", "b"] * 3


def test_many_rows_are_parquet_and_few_are_text(monkeypatch):
    few, many = table.MOST_CSV_ROWS, table.MOST_CSV_ROWS + 1
    assert [table.settled_table("auto", rows) for rows in (few, many)] == ["csv", "parquet"]
    assert table.settled_table("csv", many) == "csv"
    monkeypatch.setattr(table, "has_parquet", lambda: False)
    assert table.settled_table("auto", many) == "csv"


def test_mistakes_are_told(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"^--table xlsx: expected auto, csv, parquet$"):
        run_batch(scene(), tmp_path, 2, device="cpu", table="xlsx")

    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(table_parquet, "import_module", missing)
    with pytest.raises(MissingExtraError, match=r"^Parquet needs pyarrow: pip install 'balloon-warp\[data\]'$"):
        run_batch(scene(), tmp_path, 2, device="cpu", table="parquet")


def test_numbers_load_no_pandas(tmp_path):
    """Write numbers without pandas, which pyarrow would load, for a second; they are as they were."""
    script = f"""
import sys, pathlib, numpy as np
from balloon_warp.outputs.table_parquet import ParquetRows
rows = ParquetRows(pathlib.Path({str(tmp_path / "rows.parquet")!r}), ["world", "frame", "time", "k", "a", "health"],
                   {{"k": np.array([1.5, 2.5])}}, 2)
rows.write(3, 0.5, np.array([[4.0, 5.0]], np.float32), np.array([0, 1], np.int32))
rows.close()
sys.exit("pandas" in sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
    rows = pd.read_parquet(tmp_path / "rows.parquet").to_dict("list")
    expected = {"world": [0, 1], "frame": [3, 3], "time": [0.5, 0.5], "k": [1.5, 2.5], "a": [4.0, 5.0]}
    assert rows == {**expected, "health": [0, 1]}
