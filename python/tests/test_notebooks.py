"""The notebooks of examples/ run from top to bottom, in a folder that holds this repository's scenes."""

import json
import os
import pathlib

import pytest

ROOT = pathlib.Path(__file__).parents[2]


@pytest.mark.parametrize(
    "name, results",
    [
        ("balances", ["balances.png"]),
        ("data_set", ["set/coco.json", "set/0003.normal.npy"]),
        ("turntable", ["view-5.png", "turntable.gif"]),
    ],
)
def test_the_notebooks_run(name, results, tmp_path, monkeypatch):
    # matplotlib brings Pillow along, which the turntable needs.
    pytest.importorskip("matplotlib").use("Agg")
    notebook = json.loads((ROOT / "examples" / f"{name}.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    # Committed without results.
    assert cells and all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    os.symlink(ROOT / "scenes", tmp_path / "scenes")
    monkeypatch.chdir(tmp_path)
    names = {}
    for cell in cells:
        exec(compile("".join(cell["source"]), f"{name}.ipynb", "exec"), names)
    assert all((tmp_path / result).stat().st_size > 0 for result in results)
