#!/usr/bin/env python3
"""Puts faults into the renderer, one at a time, and says after how many random scenes `bismar study means` finds each.

    run.py [NAME...]        all of this folder's patches, or these

For each patch: git apply, build of bismar-study (profile quick), the study from seed 1 on, git apply --reverse. Exit code 1 if a
patch does not apply, does not build, or is not found in MOST scenes. The work tree must be without changes.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
STUDY = ROOT / "target/quick/bismar-study"
# Scenes per run, and in all.
STEP, MOST = 10, 200
# What each patch changes.
MUTANTS = {
    "zero-throughput": "reuse/pairs.rs: a first surface takes part that can draw a direction but not scatter it",
    "sharp-lobes": "reuse/mod.rs: second surfaces lend what sharp lobes scatter",
    "own-stop": "render/adaptive.rs: pixels stop by the errors of their own paths",
    "backs-weight": "through/back_faces.rs: lamps behind back faces have MIS weight 1",
    "coplanar": "through/back_faces.rs: a ray that passes a back face passes what lies in its plane",
    "media-air": "stages/media.rs: whatever body a path leaves, it is in air",
    "guided-density": "stages/mixture.rs: the density of the field alone, without the BSDF's share",
    "pair-jacobian": "reuse/pairs.rs: no cosine at the second surface",
    "wrong-partner": "stages/lights.rs: light samples weighted by the unguided BSDF density where the field guides",
    "learned-selection": "light/learned.rs: selected by what was learned, with the density of the tree",
    "dealt-counts": "render/deal.rs: pixels dealt by all of their own paths",
}


def git_apply(name, *how):
    return subprocess.run(["git", "apply", *how, str(HERE / f"{name}.patch")], cwd=ROOT).returncode == 0


def scenes_until_found():
    """The number of scenes until one is wrong, and what is; None if none is."""
    for first in range(1, MOST + 1, STEP):
        with tempfile.TemporaryDirectory() as folder:
            line = [STUDY, "means", "--seed", str(first), "--scenes", str(STEP), "--out", folder, "--progress", "none", "-q"]
            code = subprocess.run(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
            if code not in (0, 1):
                raise SystemExit(f"{' '.join(map(str, line))} exits with {code}")
            rows = [row for row in json.loads(Path(folder, "results.json").read_text())["rows"] if row["wrong"]]
        if rows:
            command = next((row["command"] for row in rows if row["command"]), "")
            return rows[0]["seed"], f"{rows[0]['way']}; {command}"
    return None


def try_one(name):
    if not git_apply(name):
        return "the patch does not apply"
    try:
        build = ["cargo", "build", "--profile", "quick", "--locked", "-p", "bismar-study"]
        if subprocess.run(build, cwd=ROOT).returncode != 0:
            return "the patch does not build"
        found = scenes_until_found()
    finally:
        git_apply(name, "--reverse")
    print(f"{name} ({MUTANTS[name]}): " + ("found in scene {}: {}".format(*found) if found else f"not found in {MOST} scenes"), flush=True)
    return None if found else "not found"


if __name__ == "__main__":
    if subprocess.run(["git", "diff", "--quiet"], cwd=ROOT).returncode != 0:
        raise SystemExit("the work tree has changes: commit them first")
    names = sys.argv[1:] or list(MUTANTS)
    faults = {name: fault for name in names if (fault := try_one(name))}
    for name, fault in faults.items():
        print(f"{name}: {fault}", file=sys.stderr)
    sys.exit(1 if faults else 0)
