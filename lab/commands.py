#!/usr/bin/env python3
"""Renders random commands, each in several ways that must have the same bits in every channel.

    commands.py BINARY      exit code 1 if a command fails or a way has other bits

Scenes are those of `scenes/` and one whose surfaces, lights and camera move, pictures have 32 to 128 pixels a side, flags are
random values of all of `render` that change the picture. Each command is rendered plainly, and again in four of the ways.
BISMAR_COMMANDS is their number (200), BISMAR_COMMAND the number of one to repeat. A new flag or AOV needs a line here.
"""

import array
import concurrent.futures
import importlib
import itertools
import json
import operator
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
reader = importlib.import_module("same-bits")
sys.path.append(str(ROOT / "lab/bench-peers"))
from glb import SHORT, Glb

SKIES = sorted(ROOT.glob("scenes/**/*.hdr"))
# Paths of a picture at most.
WORK = 800_000
WAYS = {
    "threads": "with another number of threads",
    "parts": "in parts, one of them killed and resumed, then merged",
    "killed": "killed after some progress, and resumed to the end",
    "stopped": "ended by SIGTERM after some progress, and resumed to the end",
    "crop": "as a crop, or the whole of a crop",
    "batch": "in a batch, beside another job of the scene",
    "sequence": "as a frame of a sequence",
    "more": "to fewer paths first, and resumed to more, unless the program says that bits are others",
}
LEFT_OUT = {
    "quiet": "output", "verbose": "output", "log": "output", "help": "output", "output": "given to every command",
    "progress": "output", "stats": "another file", "preview": "another file", "view": "of the preview",
    "view-space": "of the preview", "colorspace": "the same in other primaries",
    "exposure": "of the preview", "tev": "a viewer", "replay-pixel": "no picture", "strict": "refuses scenes",
    "denoise": "a library of others", "time": "stops by the clock", "preset": "other defaults of flags that are here",
    "frames": "a way", "threads": "a way", "part": "a way", "resume": "a way", "checkpoint": "a way", "keep": "a way",
    "turntable": "many pictures", "cameras": "many pictures", "on-checkpoint": "a program", "path-mapping": "names of files",
    "memory-limit": "refuses renders", "light-groups": "names of a scene's lights",
}
LISTED = object()
# Flags that make or need something that moves: of the scene that is made here.
MOVING = {"variant", "pose", "frame", "fps", "animation", "shutter", "motion-steps", "seed-per-frame"}
# Without the second flag, or another value of it, the first is refused or has no effect.
NEEDS = {"motion-steps": "shutter", "shutter": "frame", "seed-per-frame": "frame", "pilot": "balance=second-order",
         "focus": "aperture", "lens-blades": "aperture", "min-spp": "noise"}
# How often a flag is given, if not in every seventh command.
OFTEN = {"size": 1, "spp": 1, "aov": 0.5, "balance": 0.5, "guiding": 0.5, "frame": 0.6, "shutter": 0.5, "noise": 0.15,
         "seed": 0.5, "adaptive": 0.3, "crop": 0.2, "rays": 0.2, "glass-shadows": 0.3, "seed-per-frame": 0.5, "pilot": 0.5,
         "motion-steps": 0.3, "lens-blades": 0.3, "focus": 0.3, "min-spp": 0.3}
# A random value of every flag: one of a list, of those that the help lists, or what a function of chance and the flags
# before gives.
VALUES = {
    "size": lambda chance, _: "x".join(str(int(32 * 4 ** chance.random())) for _ in range(2)),
    "spp": lambda chance, flags: chance.choice(
        [n for n in (1, 2, 7, 16, 32, 50, 64, 100, 128, 160, 192, 256, 256, 300, 384, 512) if n * pixels(flags) <= WORK]),
    "crop": lambda chance, flags: window(chance, [0, 0, *sides(flags)]),
    "seed": lambda chance, _: chance.choice([1, 2**32 - 1, chance.randrange(2**32)]),
    "scene-name": [0], "variant": [0, "night"], "pose": [0, 0.3, 0.77], "frame": [0, 1, 2, 5, 11, 30], "fps": [10, 24, 30.5],
    "animation": [0, "all"], "shutter": ["-0.25,0.25", "0,1", "0.5,3"], "motion-steps": [1, 2, 5, 16],
    "camera": [0, "framed", "panorama"],
    "orbit": lambda chance, _: f"{chance.randrange(-180, 180)},{chance.randrange(-20, 80)},{chance.choice([0.4, 0.8, 1])}",
    "aperture": ["f/0.8", "f/2.8", "0.05"], "focus": ["auto", 1, 4.5], "lens-blades": [0, 3, 6], "back-faces": LISTED,
    "ground": LISTED, "glass-shadows": LISTED, "env": lambda chance, _: chance.choice(SKIES),
    "env-rotate": [-30, 90.5, 200], "env-strength": [0, 0.1, 3], "sky": [True], "sunsky": ["40,120", "5,-30,6", "90,0,1"], "no-env": [True], "light-unit": LISTED,
    "light-radius": [0, 0.02, 0.5, 20], "sun-angle": [0, 0.53, 10, 180],
    "energy-compensation": LISTED, "integrator": LISTED, "max-depth": [1, 2, 3, 5, 20], "noise": [0.02, 0.1, 0.3],
    "min-spp": [2, 8, 50], "adaptive": LISTED, "balance": LISTED, "pilot": [0.1, 0.4], "guiding": LISTED,
    "guiding-memory": ["1M", "16M"], "learned-lights": LISTED, "compensation": LISTED,
    "clamp-direct": [0.5, 10], "clamp-indirect": [0.5, 10], "filter": LISTED, "seed-per-frame": LISTED, "rays": LISTED,
    "half": [True], "transparent": [True], "no-clip": [True],
    "aov": lambda chance, _: chance.choice(["all", "none", ",".join(chance.sample(AOVS, chance.randrange(1, 6)))]),
}
AOVS = ["albedo", "normal", "depth", "direct", "indirect", "variance", "samples", "balance", "object", "material", "position",
        "uv", "emission", "guide-albedo", "guide-normal", "lights", "velocity", "crypto-object", "crypto-material"]


def sides(flags):
    return [int(side) for side in flags["size"].split("x")]


def pixels(flags):
    return sides(flags)[0] * sides(flags)[1]


def window(chance, outer):
    """A window of at least one pixel in another."""
    x0, x1 = sorted(chance.sample(range(outer[0], outer[2] + 1), 2))
    y0, y1 = sorted(chance.sample(range(outer[1], outer[3] + 1), 2))
    return f"{x0},{y0},{x1},{y1}"


# Of bismar, outside of any Slurm task.
ENVIRONMENT = {**{name: value for name, value in os.environ.items() if not name.startswith("SLURM_")}, "BISMAR_THREADS": "2"}


def end(code, said):
    """What is wrong with how a program ended."""
    return "" if code == 0 else f"exits with {code}: {said.strip()[-300:]}"


def floats(values):
    return array.array("f", values).tobytes()


def vectors(scene, values):
    """An accessor with bounds, which glTF wants of positions; where they really are does not matter."""
    return scene.accessor(floats(values), "VEC3", min=[-1e3] * 3, max=[1e3] * 3)


def indices(scene, values):
    return scene.accessor(array.array("H", values).tobytes(), "SCALAR", SHORT)


def floor(scene, **more):
    """A square from -1 to 1 as a primitive."""
    corners = [(-1, 0, -1), (-1, 0, 1), (1, 0, -1), (1, 0, 1)]
    attributes = {"POSITION": vectors(scene, [x for p in corners for x in p]), "NORMAL": vectors(scene, [0, 1, 0] * 4),
                  "TEXCOORD_0": scene.accessor(floats(x for p in corners for x in (p[0], p[2])), "VEC2")}
    return {"attributes": attributes, "indices": indices(scene, [0, 1, 2, 2, 1, 3]), **more}


BOX = [(x, y, z) for x in (-.5, .5) for y in (-.5, .5) for z in (-.5, .5)]
SIDES = [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]


def box(scene, **more):
    return {"attributes": {"POSITION": vectors(scene, [x for p in BOX for x in p])}, "indices": indices(scene, SIDES), **more}


def moving(path):
    """A box of glass, one of metal, lamps and the camera move over a floor; two variants of its material."""
    scene = Glb()
    paint = [scene.add("materials", doubleSided=True, pbrMetallicRoughness={"baseColorFactor": [*c, 1], "metallicFactor": m})
             for c, m in (((.7, .6, .5), 0), ((.1, .2, .6), 0), ((.9, .6, .3), .9))]
    glass = scene.add("materials", pbrMetallicRoughness={"metallicFactor": 0, "roughnessFactor": 0}, extensions={
        "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1}})
    lamp = scene.add("materials", emissiveFactor=[1, .8, .6], doubleSided=True)
    variants = {"KHR_materials_variants": {"mappings": [{"material": m, "variants": [m]} for m in paint[:2]]}}
    ground = scene.add("meshes", primitives=[floor(scene, material=paint[0], extensions=variants)])
    scene.node(mesh=ground, scale=[4, 1, 4])
    metal, bottle, bulb = (scene.add("meshes", primitives=[box(scene, material=m)]) for m in (paint[2], glass, lamp))
    lights = [{"type": "point", "intensity": 20}, {"type": "spot", "intensity": 90, "spot": {"outerConeAngle": .5}}]
    # The curves begin and end at the origin: a parent for each, at its place.
    movers = []
    for place, what in [((-1, .8, 0), {"mesh": metal}), ((1, .8, .3), {"mesh": bottle}), ((0, 2.5, -1), {"mesh": bulb}),
                        ((-2, 3, 1), {"extensions": {"KHR_lights_punctual": {"light": 0}}}), ((0, 2, 6), {"camera": 0})]:
        movers.append(scene.node(shown=False, scale=[.1, .9, .1] if what.get("mesh") == bulb else [1, 1, 1], **what))
        scene.node(children=[movers[-1]], translation=place, rotation=[-.1, 0, 0, .995])
    scene.node(translation=[2, 4, 0], rotation=[-.7, 0, 0, .7], extensions={"KHR_lights_punctual": {"light": 1}})
    # Up and down, on a curve of which no part is a line; of each key the tangent before it, the value, the tangent after it.
    seconds = scene.accessor(floats([0, 1.2]), "SCALAR", min=[0], max=[1.2])
    places = vectors(scene, [0] * 9 + [0, -9, 0, 0, 1, 0, 0, -9, 0])
    scene.json.update(animations=[{"samplers": [{"input": seconds, "output": places, "interpolation": "CUBICSPLINE"}],
                                   "channels": [{"sampler": 0, "target": {"node": n, "path": "translation"}} for n in movers]}],
                      cameras=[{"type": "perspective", "perspective": {"yfov": .8, "znear": .1}}],
                      extensionsUsed=["KHR_lights_punctual", "KHR_materials_transmission", "KHR_materials_variants",
                                      "KHR_materials_volume"],
                      extensions={"KHR_lights_punctual": {"lights": lights},
                                  "KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}})
    path.write_bytes(scene.file())


def flags_of(bismar):
    """The flags of `render` with the values that its help lists."""
    text = subprocess.run([bismar, "render", "--help"], capture_output=True, text=True, check=True).stdout
    parts = re.split(r"^ {2,6}(?:-\w, )?--([a-z-]+)", text, flags=re.M)
    found = {}
    for flag, body in zip(parts[1::2], parts[2::2]):
        short = re.search(r"\[possible values: (.*)\]", body)
        found[flag] = short.group(1).split(", ") if short else re.findall(r"^ {10}- ([\w-]+):", body, re.M)
    unknown = found.keys() ^ (VALUES.keys() | LEFT_OUT.keys())
    assert not unknown, f"flags without a place in VALUES or LEFT_OUT, or that do not exist: {', '.join(sorted(unknown))}"
    aovs = re.search(r"or all, or none: (.*)", text).group(1)
    unknown = set(re.findall(r"[a-z-]+", re.sub(r"\(.*?\)|\band\b", "", aovs))) ^ set(AOVS)
    assert not unknown, f"AOVs that are not in AOVS, or do not exist: {', '.join(sorted(unknown))}"
    return found


def draw(chance, listed, own):
    """A scene and flags."""
    scenes = sorted(ROOT.glob("scenes/**/*.glb"))
    scene = own if chance.random() < 0.3 else chance.choice(scenes)
    flags = {}
    for flag, values in VALUES.items():
        often = OFTEN.get(flag, 1 / 7)
        if flag == "env" and scene.with_suffix(".hdr").exists():
            often, values = 0.85, [scene.with_suffix(".hdr")]
        lacks = flag in NEEDS and NEEDS[flag] not in {*flags, *(f"{name}={value}" for name, value in flags.items())}
        if flag in MOVING and scene != own or lacks and chance.random() < 0.95 or chance.random() >= often:
            continue
        values = listed[flag] if values is LISTED else values
        flags[flag] = values(chance, flags) if callable(values) else chance.choice(values)
    return scene, flags


def difference(a, b):
    """What differs between two pictures, of which one may be a crop of the other."""
    a, b = reader.read_exr(a), reader.read_exr(b)
    if a.keys() != b.keys():
        return f"channels {sorted(a.keys() ^ b.keys())}"
    size = lambda picture: picture["window"][2] - picture["window"][0] + 1
    (x0, y0, _, y1), (bx, by, *_) = a["window"], b["window"]
    found = []
    for name in a.keys() - {"window"}:
        rows = (b[name][(y - by) * size(b) + x0 - bx:][:size(a)] for y in range(y0, y1 + 1))
        whole = a["window"] == b["window"]
        count = 0 if whole and a[name] == b[name] else sum(map(operator.ne, a[name], itertools.chain(*rows)))
        found += [f"{name} ({count} of {len(a[name])} values)"] if count else []
    return ", ".join(sorted(found)[:3]) + (f" and {len(found) - 3} other channels" if len(found) > 3 else "")


class Command:
    """A command, and the ways to render it. A way returns what is wrong, if anything is."""

    def __init__(self, bismar, folder, scene, flags, chance):
        self.bismar, self.folder, self.scene, self.flags, self.chance = bismar, folder, scene, flags, chance
        self.seconds = 0
        # How often a signal ended a render, and how often a picture was not compared.
        self.hits = self.others = 0

    def line(self, output, **more):
        flags = {**self.flags, "output": output, **{name.replace("_", "-"): value for name, value in more.items()}}
        words = [f"--{flag}" if value is True else f"--{flag}={value}" for flag, value in flags.items() if value is not None]
        return ["render", str(self.scene), *words]

    def shown(self):
        return " ".join(self.line("out.exr")).replace(f"{ROOT}/", "").replace(f"{self.scene.parent}/", "")

    def start(self, words):
        return subprocess.Popen([self.bismar, *words], cwd=self.folder, env=ENVIRONMENT, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True, errors="replace")

    def run(self, words):
        """Exit code, or None of what takes ten minutes, and stderr."""
        process = self.start(words)
        try:
            said = process.communicate(timeout=600)[1]
            return process.returncode, said
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return None, "hangs"

    def ended(self, words):
        return end(*self.run(words))

    def same(self, output="way.exr"):
        return difference(self.folder / output, self.folder / "plain.exr")

    def interrupted(self, number, output, **more):
        """Ended up to three times, each after progress; then resumed to the end."""
        if number == signal.SIGKILL or self.chance.random() < 0.5:
            more.update(checkpoint=0.02, keep=self.chance.choice([None, 2]))
        words = self.line(output, resume=True, progress="json", **more)
        file = self.folder / output
        saved = lambda: file.stat().st_mtime_ns if file.exists() else None
        for _ in range(3):
            before = saved()
            process = self.start([*words, f"--threads={self.chance.choice([1, 2, 3])}"])
            if number == signal.SIGKILL:
                while process.poll() is None and saved() == before:
                    time.sleep(0.002)
            else:
                next((line for line in process.stdout if '"render"' in line), None)
            try:
                process.wait(self.chance.uniform(0, 0.7 * self.seconds))
            except subprocess.TimeoutExpired:
                process.send_signal(number)
            said = process.communicate()[1]
            if process.returncode == 0:
                break
            if process.returncode != (-9 if number == signal.SIGKILL else 75):
                return end(process.returncode, said)
            self.hits += 1
        return self.ended([*words, "--quiet"])

    def threads(self):
        return self.ended(self.line("way.exr", threads=self.chance.choice([1, 3, 5]))) or self.same()

    def parts(self):
        x0, y0, x1, y1 = map(int, self.flags.get("crop", "0,0," + self.flags["size"].replace("x", ",")).split(","))
        tiles = (-(-x1 // 16) - x0 // 16) * (-(-y1 // 16) - y0 // 16)
        count = min(tiles, self.chance.randrange(2, 5))
        names = [f"part{k}.exr" for k in range(1, count + 1)]
        killed = self.chance.randrange(count)
        for k, name in enumerate(names):
            more = {"part": f"{k + 1}/{count}"}
            wrong = self.interrupted(signal.SIGKILL, name, **more) if k == killed else self.ended(self.line(name, **more))
            if wrong:
                return wrong
        self.chance.shuffle(names)
        return self.ended(["merge", *names, "-o", "way.exr"]) or self.same()

    def killed(self):
        return self.interrupted(signal.SIGKILL, "way.exr") or self.same()

    def stopped(self):
        return self.interrupted(signal.SIGTERM, "way.exr") or self.same()

    def crop(self):
        crop = window(self.chance, [0, 0, *sides(self.flags)])
        wrong = self.ended(self.line("way.exr", crop=None if "crop" in self.flags else crop))
        files = [self.folder / name for name in ("way.exr", "plain.exr")]
        return wrong or difference(*(reversed(files) if "crop" in self.flags else files))

    def batch(self):
        def job(name, flags):
            word = lambda value: str(value).lower() if value in (True, "true", "false") else f"'{value}'"
            keys = "".join(f"{flag} = {word(value)}\n" for flag, value in flags.items())
            return f"[[job]]\nscene = '{self.scene}'\nname = '{name}'\noutput = '{name}.exr'\n{keys}\n"
        jobs = [job("way", self.flags), job("other", {**self.flags, "seed": 77, "spp": 16})]
        self.chance.shuffle(jobs)
        (self.folder / "jobs.toml").write_text("".join(jobs))
        return self.ended(["batch", "jobs.toml", f"--jobs={self.chance.choice([1, 2])}"]) or self.same()

    def sequence(self):
        frame = self.flags["frame"]
        more = {"frames": f"{max(frame - 2, 0)}-{frame + 1}", "seed_per_frame": self.flags.get("seed-per-frame", "false")}
        return self.ended(self.line("way.####.exr", frame=None, **more)) or self.same(f"way.{frame:04}.exr")

    def more(self):
        """From any number of paths. Bits are the same from a multiple of 128, unless paths may be guided or a noise ends it;
        otherwise the program says where they are not."""
        goal = self.flags["spp"]
        first = self.chance.choice([*range(128, goal, 128)] * 2 + [n for n in (8, 32, 64, 100) if n < goal] or [1])
        wrong = self.ended(self.line("way.exr", spp=first, checkpoint=60))
        code, said = self.run(self.line("way.exr", checkpoint=60, resume=True))
        if wrong := wrong or end(code, said):
            return wrong
        off = self.flags.get("guiding", "off" if "balance" in self.flags else "auto") == "off"
        promised = off and first % 128 == 0 and "noise" not in self.flags
        # A noise that was reached before is the end of it.
        if "not bit-identical" in said and not promised or "noise" in self.flags and "nothing to do" in said:
            self.others += 1
            return ""
        found = self.same()
        return found and f"after {first} paths: {found}"

    def ways(self):
        """Four of those that the command has."""
        fit = {"sequence": "frame" in self.flags,
               "more": self.flags["spp"] > 1 and self.flags.get("balance") != "second-order"}
        rare = [way for way in fit if fit[way]]
        return rare + self.chance.sample([way for way in WAYS if way not in fit], 4 - len(rare))


def attempt(bismar, folder, listed, own, number):
    """The command of a number: itself, how many were refused before it, what is wrong by way, and of the ways how many signals
    took effect and how many pictures were not compared."""
    chance, refused, place = random.Random(f"command {number}"), 0, folder / str(number)
    while True:
        place.mkdir()
        command = Command(bismar, place, *draw(chance, listed, own), random.Random(number))
        began = time.monotonic()
        code, said = command.run(command.line("plain.exr"))
        command.seconds = time.monotonic() - began
        if code != 64:
            break
        refused += 1
        if "BISMAR_COMMAND" in os.environ:
            print(f"refused: {command.shown()}\n{said}")
        shutil.rmtree(place)
    ends, hits = {"plain": end(code, said)}, {}
    for way in command.ways() if code == 0 else []:
        command.hits = command.others = 0
        ends[way] = getattr(command, way)()
        hits[way] = command.hits, command.others
        for path in place.glob("way*"):
            path.unlink()
    for way, wrong in ends.items():
        if wrong:
            print(f"command {number}, {way}: {wrong}\n  {command.shown()}", flush=True)
    shutil.rmtree(place)
    return number, command, refused, ends, hits


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    bismar = str(Path(sys.argv[1]).resolve())
    listed = flags_of(bismar)
    only = os.environ.get("BISMAR_COMMAND")
    numbers = [int(only)] if only else range(int(os.environ.get("BISMAR_COMMANDS", 200)))
    with tempfile.TemporaryDirectory() as name, concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        folder = Path(name)
        own = folder / "moving.glb"
        moving(own)
        found = list(pool.map(lambda number: attempt(bismar, folder, listed, own, number), numbers))

    def report(what, tries, way, *remarks):
        failed = [f"{n}: `{c.shown()}`: {ends[way]}" for n, c, _, ends, _ in found if ends.get(way)]
        print(f"{what}: {len(failed)} of {tries} {'; '.join([*remarks, *failed])}", flush=True)

    given = {flag for _, command, *_ in found for flag in command.flags}
    report("commands: any other end than a picture", len(found), "plain",
           f"{sum(refused for _, _, refused, *_ in found)} more were refused as wrong usage",
           f"{len(given)} of {len(VALUES)} flags",
           f"{sum(len(c.flags) for _, c, *_ in found) / len(found):.1f} a command")
    for way, what in WAYS.items():
        ended, others = (sum(hits.get(way, (0, 0))[i] for *_, hits in found) for i in range(2))
        remarks = [f"{ended} signals took effect"] * (ended > 0) + [f"{others} more were not compared"] * (others > 0)
        report(f"{what}: other bits", sum(way in ends for *_, ends, _ in found) - others, way, *remarks)
    sys.exit(any(wrong for *_, ends, _ in found for wrong in ends.values()))


if __name__ == "__main__":
    main()
