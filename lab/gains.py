#!/usr/bin/env python3
"""The table of docs/adaptive.md: relMSE and CPU seconds of the plain command over those of --balance half.

    gains.py --models FOLDER --scenes FOLDER [--seeds N] [NAME...]

FOLDER of models: FlightHelmet, MarbleTower, ... of public collections, one folder each; of scenes: modern_hall.glb, veach_mis.glb,
spaceship.glb and its sky. Pictures of 320 x 240 with 64 paths a pixel. relMSE is the scatter of pictures of different seeds over the
square of their mean plus 0.01; CPU seconds are the least of these, of the whole process. Rows are printed as they are made.
Needs Python with NumPy and OpenImageIO (scripts/setup.sh --pictures: target/pictures/bin/python).
"""

import argparse
import json
import math
import os
import subprocess
import tempfile
from pathlib import Path

import numpy
import OpenImageIO

ROOT = Path(__file__).resolve().parent.parent
OURS = ["cornell", "veach", "many-lights", "glossy-sun", *(f"study/{name}" for name in (
    "ajar brushed foliage mirrors night screen shade slats slit uplights window".split()))]
NOON, SUNSET = ["--sunsky", "60,140"], ["--sunsky", "6,140"]
MODELS = {"FlightHelmet/FlightHelmet.gltf": [], "MarbleTower/marbleTower.gltf": SUNSET, "house/house.glb": NOON,
          "usd_shader_ball/usd-shaderball-ball.glb": [], "webxr_camp/camp.gltf": NOON, "webxr_cave/cave.gltf": SUNSET}
PUBLIC = {"modern hall": "modern_hall.glb", "VeachMIS": "veach_mis.glb", "spaceship": "spaceship.glb"}


def scenes(models, public):
    """(name, file, flags) of every scene."""
    def with_sky(path):
        sky = path.with_suffix(".hdr")
        return path, ["--env", str(sky)] if sky.exists() else []
    yield from ((Path(name).name, *with_sky(ROOT / f"scenes/{name}.glb")) for name in OURS)
    yield from ((Path(name).parent.name, models / name, flags) for name, flags in MODELS.items())
    yield from ((name, *with_sky(public / file)) for name, file in PUBLIC.items())


def pictures(bismar, scene, flags, seeds):
    """(beauty of every seed, least CPU seconds, mean rays, names of the techniques that pictures of all seeds use)"""
    beauty, seconds, rays = [], math.inf, 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(seeds):
            before = os.times()
            subprocess.run([bismar, "-q", "render", scene, *flags, "--size", "320x240", "--spp", "64", "--seed", str(seed), "-o",
                            f"{folder}/a.exr", "--stats", f"{folder}/a.json"], check=True)
            after = os.times()
            seconds = min(seconds, after.children_user - before.children_user + after.children_system - before.children_system)
            beauty.append(OpenImageIO.ImageBuf(f"{folder}/a.exr").get_pixels(OpenImageIO.FLOAT)[..., :3].astype(float))
            stats = json.loads(Path(f"{folder}/a.json").read_text())
            rays += stats["rays"]["total"] / seeds
    used = ", ".join(name.replace("_", " ").replace("reuse", "re-use") for name, of in stats["techniques"].items() if of["on"])
    return numpy.array(beauty), seconds, rays, used or "none"


def row(bismar, scene, flags, seeds):
    """Error, CPU seconds and rays of the plain command over those of half; the error too without the worst hundredth."""
    half, half_seconds, half_rays, _ = pictures(bismar, scene, [*flags, "--balance", "half"], seeds)
    plain, seconds, rays, used = pictures(bismar, scene, flags, seeds)
    mean = (half.mean(axis=0) + plain.mean(axis=0)) / 2
    errors = [(of.var(axis=0, ddof=1) / (mean ** 2 + 0.01)).mean(axis=2).ravel() for of in (plain, half)]
    error = errors[0].mean() / errors[1].mean()
    best = [numpy.sort(of)[: len(of) * 99 // 100].mean() for of in errors]
    return [error, seconds / half_seconds, best[0] / best[1] * seconds / half_seconds, error * rays / half_rays], used


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, required=True)
    parser.add_argument("--scenes", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--bismar", default=str(ROOT / "target/release/bismar"))
    parser.add_argument("names", nargs="*")
    args = parser.parse_args()
    print("| scene | relMSE × CPU seconds | without the worst 1 % | relMSE × rays | what it chose |\n| --- | --- | --- | --- | --- |")
    rows = {}
    for name, scene, flags in scenes(args.models, args.scenes):
        if not args.names or name in args.names:
            numbers, used = row(args.bismar, scene, flags, args.seeds)
            rows[name] = numbers
            print(line(name, numbers, used), flush=True)
    if not args.names:
        geometric = lambda of: numpy.exp(numpy.log(list(of)).mean(axis=0))
        print(line("geometric mean of the first 21", geometric(list(rows.values())[:21]), ""))
        print(line("geometric mean of all", geometric(rows.values()), ""))


def line(name, numbers, used):
    error, seconds, best, rays = numbers
    short = lambda x: f"{x:.2f}" if x >= 0.1 else f"{x:.2g}"
    return f"| {name} | {short(error)} × {seconds:.2f} = **{short(error * seconds)}** | {short(best)} | {short(rays)} | {used} |"


if __name__ == "__main__":
    main()
