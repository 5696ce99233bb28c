"""docs/python.md runs as it stands."""

import os
import pathlib
import re

ROOT = pathlib.Path(__file__).parents[2]


def test_the_commands_of_the_documentation_run(tmp_path, monkeypatch):
    text = (ROOT / "docs" / "python.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S)
    assert len(blocks) == 7
    os.symlink(ROOT / "scenes", tmp_path / "scenes")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)
    assert (tmp_path / "both.png").stat().st_size > 0 and names["beauty"].shape == (64, 96, 4)
