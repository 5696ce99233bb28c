import os
import pathlib
import shutil

import pytest

import bismar

ROOT = pathlib.Path(__file__).parents[2]


@pytest.fixture(scope="session")
def scenes() -> pathlib.Path:
    return ROOT / "scenes"


@pytest.fixture(scope="session")
def cornell(scenes) -> bismar.Scene:
    return bismar.load(scenes / "cornell.glb")


@pytest.fixture(scope="session")
def program() -> str:
    """The command line, built from the same sources."""
    found = os.environ.get("BISMAR") or shutil.which("bismar")
    assert found, "set BISMAR to the program"
    return found
