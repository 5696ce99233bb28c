#!/usr/bin/env python3
"""Compares pictures with those of other renderers in Khronos' fidelity suite, and writes lab/fidelity.md.

    fidelity.py --suite FOLDER --config FILE --models FOLDER... --environments FOLDER... [--write]

Everything is read from disk, nothing is fetched:
- the suite: a clone of KhronosGroup/glTF-Render-Fidelity, whose public/thumbnails/goldens has the pictures;
- the config: the suite's scenarios (comparison/results/config.json of that repository, or test/config.json of
  KhronosGroup/glTF-Render-Fidelity-Generator): model, lighting, size, orbit, target, field of view;
- models: folders that are searched for NAME.glb or NAME.gltf, such as glTF-Sample-Assets;
- environments: folders that are searched for the file that a scenario names, such as lightroom_14b.hdr.

A scenario without its model is left out. One without its environment is rendered under an even sky, for the comparison of
silhouettes (alpha) alone, which light does not change. Pictures stay in --out, and are rendered again with --again.
Needs Python with NumPy and OpenImageIO (scripts/setup.sh --pictures: target/pictures/bin/python).
"""

import argparse
import json
import math
import shlex
import subprocess
import sys
from pathlib import Path
from statistics import median

import numpy
import OpenImageIO

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "lab/fidelity.md"
PATH_TRACERS = {"blender-cycles": "Cycles", "vray": "V-Ray", "stellar": "STELLAR", "three-gpu-pathtracer": "three-gpu-pathtracer"}
PEERS = {**PATH_TRACERS, "gltf-sample-viewer": "Sample Viewer", "filament": "Filament"}
FURTHEST = 10
# Rows of the table; results.json has all.
SHOWN = 8
# What a scenario of the generator's config does not say.
DEFAULTS = {"lighting": "lightroom_14b.hdr", "dimensions": {"width": 768, "height": 768}, "target": {"x": 0, "y": 0, "z": 0},
            "orbit": {"theta": 0, "phi": 90, "radius": 1}, "verticalFoV": 45, "renderSkybox": False}


def complete(scenario):
    """The scenario with the suite's defaults for what it leaves out."""
    nested = {key: {**value, **scenario.get(key, {})} for key, value in DEFAULTS.items() if isinstance(value, dict)}
    return {**DEFAULTS, **scenario, **nested}


def camera(scenario):
    """The scenario's camera as the content of a transforms.json: model-viewer's orbit, camera to world, row by row.

    `theta` is the azimuth about +y in degrees, 0 on +z; `phi` the angle from +y; `radius` is in metres.
    """
    theta, phi = (math.radians(scenario["orbit"][name]) for name in ("theta", "phi"))
    backward = [math.sin(phi) * math.sin(theta), math.cos(phi), math.sin(phi) * math.cos(theta)]
    right = [math.cos(theta), 0.0, -math.sin(theta)]
    up = [backward[1] * right[2] - backward[2] * right[1], backward[2] * right[0] - backward[0] * right[2],
          backward[0] * right[1] - backward[1] * right[0]]
    target = [scenario["target"][axis] for axis in "xyz"]
    rows = [[right[i], up[i], backward[i], target[i] + scenario["orbit"]["radius"] * backward[i]] for i in range(3)]
    return {"camera_angle_y": math.radians(scenario["verticalFoV"]),
            "w": scenario["dimensions"]["width"], "h": scenario["dimensions"]["height"],
            "frames": [{"file_path": "view", "transform_matrix": [*rows, [0.0, 0.0, 0.0, 1.0]]}]}


def find_model(scenario, folders):
    """The model's file in the folders, or None: by its path in glTF-Sample-Assets, else by its name."""
    name = Path(scenario["model"]).stem
    inner = scenario["model"].split("glTF-Sample-Assets/")[-1].lstrip("./")
    for folder in folders:
        if (folder / inner).is_file():
            return folder / inner
    for folder in folders:
        for path in sorted(folder.rglob(f"{name}.gl*")):
            if path.suffix in (".glb", ".gltf") and "malformed" not in path.parts:
                return path
    return None


def find_environment(scenario, folders):
    """The environment's file in the folders, or None."""
    name = Path(scenario["lighting"]).name
    return next((f for folder in folders for f in sorted(folder.rglob(name))), None)


def read(path):
    """A picture as rows x columns x RGBA from 0 to 1, colours times alpha; opaque if it has no alpha."""
    file = OpenImageIO.ImageInput.open(str(path))
    if not file:
        sys.exit(f"fidelity: {path}: {OpenImageIO.geterror()}")
    pixels = file.read_image("float")[..., :4]  # OpenImageIO multiplies colours by alpha
    if pixels.shape[2] == 3:
        pixels = numpy.dstack([pixels, numpy.ones(pixels.shape[:2], pixels.dtype)])
    return pixels


def write(path, pixels):
    """Writes rows x columns x RGB as an 8-bit PNG."""
    pixels = numpy.ascontiguousarray(pixels, dtype=numpy.float32)
    spec = OpenImageIO.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], "uint8")
    out = OpenImageIO.ImageOutput.create(str(path))
    if not (out and out.open(str(path), spec) and out.write_image(pixels) and out.close()):
        sys.exit(f"fidelity: {path}: {OpenImageIO.geterror()}")


def scaled(pixels, width, height):
    """A picture at another size, from 0 to 1."""
    if pixels.shape[:2] == (height, width):
        return pixels
    roi = OpenImageIO.ROI(0, width, 0, height, 0, 1, 0, pixels.shape[2])
    made = OpenImageIO.ImageBufAlgo.resize(OpenImageIO.ImageBuf(numpy.ascontiguousarray(pixels)), roi=roi)
    return numpy.clip(made.get_pixels(OpenImageIO.FLOAT, roi), 0, 1)


def over_white(pixels):
    """RGB over white, as the suite's site shows pictures without a skybox."""
    return pixels[..., :3] + (1 - pixels[..., 3:])


def overlap(ours, theirs):
    """Intersection over union of two alphas, soft: the sum of their minimum over that of their maximum; 1 if both are empty."""
    union = float(numpy.maximum(ours, theirs).sum())
    return float(numpy.minimum(ours, theirs).sum()) / union if union else 1.0


class Suite:
    """The suite's pictures, Bismar's of the same scenarios, and their distances."""

    def __init__(self, options):
        self.options = options
        self.goldens = options.suite / "public/thumbnails/goldens"
        if not self.goldens.is_dir():
            sys.exit(f"fidelity: {self.goldens} does not exist: --suite is a clone of KhronosGroup/glTF-Render-Fidelity")

    def peers(self, name):
        """The other renderers' pictures of a scenario, by name, all of one size."""
        found = {}
        for peer in PEERS:
            path = self.goldens / name / f"{peer}-golden.thumb.webp"
            if path.is_file():
                found[peer] = read(path)
        if found:
            height, width = next(iter(found.values())).shape[:2]
            found = {peer: scaled(pixels, width, height) for peer, pixels in found.items()}
        return found

    def ours(self, scenario, model, environment, width, height):
        """Bismar's picture of a scenario at the size of the thumbnails."""
        folder = self.options.out / scenario["name"]
        folder.mkdir(parents=True, exist_ok=True)
        picture, png = folder / "view.exr", folder / "view.png"
        if self.options.again or not png.is_file():
            (folder / "camera.json").write_text(json.dumps(camera(scenario)))
            light = ["--env", environment] if environment else ["--sky"]
            hidden = [] if scenario["renderSkybox"] and environment else ["--transparent"]
            flags = shlex.split(self.options.flags)
            command = [self.options.bismar, "-q", "render", model, "--cameras", folder / "camera.json", "--camera", "view", *light,
                       *hidden, "--view", "aces", "--exposure", "0", "--filter", "box", "--spp", str(self.options.spp), "--aov",
                       "none", *flags, "-o", picture, "--preview", png]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                return None, done.stderr.strip().splitlines()[-1]
            picture.unlink()
        return scaled(read(png), width, height), ""

    def flip(self, scenario, ours, theirs):
        """The mean FLIP error between two RGB pictures, by `bismar compare`."""
        folder = self.options.out / scenario["name"]
        write(folder / "a.png", ours)
        write(folder / "b.png", theirs)
        done = subprocess.run([self.options.bismar, "-q", "compare", folder / "a.png", folder / "b.png", "--json"],
                              check=True, capture_output=True, text=True)
        return json.loads(done.stdout)["flip"]

    def compare(self, scenario, ours, peers, lit):
        """A scenario's rows: FLIP to the path tracers' mean (if the light is the suite's), and overlap of silhouettes.

        Another path tracer is compared with the mean of the *others*, since its own picture is in the mean of all. The overlap
        is with the median alpha of all, again without its own.
        """
        flat = {name: over_white(pixels) for name, pixels in peers.items()}
        result = {"scenario": scenario["name"], "name": scenario["name"].removeprefix("khronos-"), "flip": {}, "overlap": {}}
        tracers = [name for name in flat if name in PATH_TRACERS]
        if lit and tracers:
            for name, pixels in {"bismar": over_white(ours), **flat}.items():
                others = [flat[tracer] for tracer in tracers if tracer != name]
                if others:
                    result["flip"][name] = self.flip(scenario, pixels, numpy.mean(others, axis=0))
            mean = numpy.mean([flat[tracer] for tracer in tracers], axis=0)
            strip = [over_white(ours), mean, *(flat[name] for name in flat)]
            write(self.options.out / scenario["name"] / "strip.png", numpy.concatenate(strip, axis=1))
            result["strip"] = ["Bismar", "mean of the path tracers", *(PEERS[name] for name in flat)]
        if not scenario["renderSkybox"]:
            for name, pixels in {"bismar": ours, **peers}.items():
                others = [peers[peer][..., 3] for peer in peers if peer != name]
                if others:
                    result["overlap"][name] = overlap(pixels[..., 3], numpy.median(others, axis=0))
        return result

    def run(self, scenarios):
        """All scenarios that can be shown, and what was left out: scenario and reason."""
        rows, left_out = [], []
        for scenario in scenarios:
            name = scenario["name"]
            peers = self.peers(name)
            model = find_model(scenario, self.options.models)
            environment = find_environment(scenario, self.options.environments)
            lit = environment is not None
            if not peers:
                left_out.append((name, "no golden picture in the suite"))
            elif not model:
                left_out.append((name, "its model is in no folder of --models"))
            elif not lit and scenario["renderSkybox"]:
                left_out.append((name, f"{Path(scenario['lighting']).name} is in no folder of --environments"))
            else:
                height, width = next(iter(peers.values())).shape[:2]
                ours, why = self.ours(scenario, model, environment, width, height)
                if ours is None:
                    left_out.append((name, why))
                    continue
                rows.append(self.compare(scenario, ours, peers, lit))
                said = {key: round(rows[-1][key].get("bismar", math.nan), 3) for key in ("flip", "overlap")}
                print(f"{name}: FLIP {said['flip']}, overlap of silhouettes {said['overlap']}", file=sys.stderr)
                if not lit:
                    left_out.append((name, f"FLIP only: {Path(scenario['lighting']).name} is in no folder of --environments"))
        return rows, left_out


def furthest(rows):
    """Scenarios whose light can be compared, the furthest first."""
    return sorted((row for row in rows if "bismar" in row["flip"]), key=lambda row: -row["flip"]["bismar"])


def table(rows):
    """FLIP by scenario and renderer; marks where Bismar is further than all path tracers."""
    lines = ["| scenario | Bismar | " + " | ".join(PEERS.values()) + " |", "| --- " * (len(PEERS) + 2) + "|"]
    for row in rows:
        flip = row["flip"]
        tracers = [flip[name] for name in PATH_TRACERS if name in flip]
        # One of the others has nothing to be compared with; two are compared with each other.
        mark = "**" if tracers and flip["bismar"] > max(tracers) else ""
        cells = [f"{mark}{flip['bismar']:.3f}{mark}", *(f"{flip[name]:.3f}" if name in flip else "" for name in PEERS)]
        lines.append(f"| {row['name']} | " + " | ".join(cells) + " |")
    return lines


def summary(rows, key, digits):
    """Bismar's median beside that of the path tracers, in scenarios that have both, and how often Bismar is not the furthest."""
    both = [row for row in rows if "bismar" in row[key] and any(name in row[key] for name in PATH_TRACERS)]
    if not both:
        return "No scenario has two path tracers."
    worst = max if key == "flip" else min
    theirs = [median([row[key][name] for name in PATH_TRACERS if name in row[key]]) for row in both]
    inside = sum(worst(row[key]["bismar"], bound) == bound for row in both
                 for bound in [worst(row[key][name] for name in PATH_TRACERS if name in row[key])])
    return (f"In {len(both)} scenarios with two or more path tracers the median is {median([r[key]['bismar'] for r in both]):.{digits}f} "
            f"for Bismar and {median(theirs):.{digits}f} for the path tracers; in {inside} of them Bismar is no further than the "
            "furthest path tracer.")


def tables(rows, left_out):
    """What the page has between its marks."""
    made = {"fidelity-flip": [summary(rows, "flip", 3), "", *table(furthest(rows)[:SHOWN])],
            "fidelity-silhouettes": [summary(rows, "overlap", 4)]}
    reasons = {}
    for name, why in left_out:
        reasons.setdefault(why, []).append(name.removeprefix("khronos-"))
    made["fidelity-left-out"] = [f"- {why}: {', '.join(names) if len(names) < 9 else f'{len(names)} scenarios'}." for why, names in reasons.items()] or ["Nothing."]
    return {name: "\n".join(lines) for name, lines in made.items()}


def put(text, name, content):
    """The page's text with what stands between `<!-- NAME -->` and `<!-- /NAME -->` replaced."""
    start, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    before, rest = text.split(start, 1)
    return before + start + content + "\n" + end + rest.split(end, 1)[1]


def gallery(rows, out):
    """An HTML page of the scenarios furthest from the mean, side by side with the others."""
    parts = ["<!doctype html><meta charset=utf-8><title>Fidelity</title><style>body{font-family:sans-serif}img{width:100%}</style>"]
    for row in furthest(rows)[:FURTHEST]:
        parts.append(f"<h2>{row['name']}: FLIP {row['flip']['bismar']:.3f}</h2><p>{', '.join(row['strip'])}</p>"
                     f"<img src=\"{row['scenario']}/strip.png\">")
    (out / "index.html").write_text("\n".join(parts))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", type=Path, required=True, metavar="FOLDER", help="clone of KhronosGroup/glTF-Render-Fidelity")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="JSON with the suite's scenarios")
    parser.add_argument("--models", type=Path, nargs="+", required=True, metavar="FOLDER")
    parser.add_argument("--environments", type=Path, nargs="+", default=[], metavar="FOLDER")
    parser.add_argument("--bismar", type=Path, default=ROOT / "target/release/bismar", metavar="PROGRAM")
    parser.add_argument("--out", type=Path, default=ROOT / "out/fidelity", metavar="FOLDER")
    parser.add_argument("--spp", type=int, default=128, metavar="N", help="paths per pixel [default: 128]")
    parser.add_argument("--flags", default="", metavar="FLAGS", help="further flags of `bismar render`, in one string")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only these scenarios")
    parser.add_argument("--again", action="store_true", help="render pictures again that are in --out")
    parser.add_argument("--write", action="store_true", help="put the tables into lab/fidelity.md")
    options = parser.parse_args()
    scenarios = [complete(scenario) for scenario in json.loads(options.config.read_text())["scenarios"]]
    if options.only:
        scenarios = [s for s in scenarios if s["name"].removeprefix("khronos-") in options.only]
    rows, left_out = Suite(options).run(scenarios)
    made = tables(rows, left_out)
    gallery(rows, options.out)
    (options.out / "results.json").write_text(json.dumps(rows, indent=1))
    if options.write:
        text = PAGE.read_text()
        for name, content in made.items():
            text = put(text, name, content)
        PAGE.write_text(text)
    else:
        print("\n\n".join(made.values()))


if __name__ == "__main__":
    main()
