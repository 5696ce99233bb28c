#!/usr/bin/env python3
"""Puts faults into the renderer, one at a time, and says after how many random scenes `bismar study means` finds each.

    run.py [NAME...]        all of this folder's patches, or these

For each patch: git apply, build of bismar-study (profile quick), the study from seed 1 on, scene by scene until one is wrong, git
apply --reverse. Exit code 1 if a patch does not apply, does not build, or is not found in MOST scenes. The work tree must be without
changes.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
STUDY = ROOT / "target/quick/bismar-study"
# The most scenes, those of `make test`.
MOST = 40
# What each patch changes.
MUTANTS = {
    "zero-throughput": "reuse/pairs.rs: a first surface takes part that can draw a direction but not scatter it",
    "sharp-lobes": "reuse/pairs.rs: sharp lobes are lent, by the density toward the lender's own first surface",
    "shared-stop": "render/pass/sampler.rs: pixels of different stop groups share paths",
    "backs-lights": "stages/lights.rs: light samples do not pass back faces, mirror images do",
    "coplanar": "through/back_faces.rs: a ray that passes a back goes on behind the front in the same place",
    "media-air": "surface/media.rs: whatever body a ray leaves, it is in air",
    "guided-density": "stages/mixture.rs: directions of the BSDF without the field's share of their density",
    "guided-roulette": "stages/scatter.rs: paths that survive the field's roulette are not divided by its probability",
    "wrong-partner": "stages/lights.rs: light samples weighted by the density of the BSDF where the field guides",
    "pair-jacobian": "reuse/pairs.rs: no cosine at the second surface",
    "pair-visibility": "reuse/pairs.rs: occluded pairs stay in the divisor",
    "learned-selection": "light/tree.rs: lights chosen by what was learned, with the probability of the tree",
}


def git_apply(name, *how):
    return subprocess.run(["git", "apply", *how, str(HERE / f"{name}.patch")], cwd=ROOT).returncode == 0


def scene_that_finds_it():
    """The first scene that is wrong, and what is; None if none is."""
    for seed in range(1, MOST + 1):
        with tempfile.TemporaryDirectory() as folder:
            line = [STUDY, "means", "--seed", str(seed), "--scenes", "1", "--out", folder, "--progress", "none", "-q"]
            code = subprocess.run(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
            if code not in (0, 1):
                raise SystemExit(f"{' '.join(map(str, line))} exits with {code}")
            rows = [row for row in json.loads(Path(folder, "results.json").read_text())["rows"] if row["wrong"]]
        if rows:
            worst = next((row for row in rows if row["command"]), rows[0])
            return seed, f"{worst['way']}; {worst['command']}"
    return None


def try_one(name):
    if not git_apply(name):
        return "the patch does not apply"
    try:
        build = ["cargo", "build", "--profile", "quick", "--locked", "-p", "bismar-study"]
        if subprocess.run(build, cwd=ROOT).returncode != 0:
            return "the patch does not build"
        found = scene_that_finds_it()
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
