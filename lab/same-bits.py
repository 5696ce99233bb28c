#!/usr/bin/env python3
"""Checks that two builds of bismar make the same pictures, statistics and studies, to the bit.

    same-bits.py record BINARY FOLDER    renders all cases and keeps the results in FOLDER
    same-bits.py check BINARY FOLDER     renders them again and lists what differs; exit code 1 if anything does

The script compares all values of every channel of a picture, and all values of JSON and CSV files except times, memory,
threads and versions. JSON fields that the record lacks are allowed; channels are not. Header attributes, logs and pages
are not compared. It needs only Python 3.9: its OpenEXR reader is independent of the program's.
"""

import argparse
import concurrent.futures
import csv
import itertools
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from array import array
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared/gltf"
SKY = SHARED / "env/studio_small_03_1k"

# Fields that depend on the machine, the time or the build.
UNSTEADY = re.compile(
    r"bismar\.mark|version|commit|command|picture|.*seconds.*|.*memory.*|threads|.*_per_second|isa|file|ray_query_share|(equal_)?time_ratio.*|"
    r"inverse_efficiency")

BALANCES = ["progressive", "second-order", "kl", "efficiency-aware", "half", "power", "max"]
OWN = ["cornell", "field", "glossy-sun", "many-lights", "showpiece", "veach"] + [
    f"study/{name}" for name in
    ["brushed", "foliage", "mirrors", "night", "screen", "slats", "uplights", "window"]]
# Textures and normal maps, masks and blending, punctual lights, instances, vertex colours, several UV sets, sparse
# accessors, an orthographic camera, extensions with approximate support.
STRANGERS = [
    "materials/NormalTangentTest", "materials/AlphaBlendModeTest", "materials/bio_01_alpha_mask",
    "materials/TextureTransformTest", "materials/bio_01_unlit", "materials/SpecularTest",
    "lights/Cubes_point", "lights/Lights", "geometry/bio_24_gpu_instancing", "geometry/VertexColorTest",
    "geometry/MultiUVTest", "geometry/NegativeScaleTest", "geometry/SimpleSparseAccessor", "cameras/Cameras",
    "scenes/MixedLighting", "kaykit/table_medium_tablecloth.gltf.glb"]
RENDER = "render {} -q --progress none --size 60x36"


def strangers():
    """Scene files of the shared set, by name."""
    for name in STRANGERS:
        path = SHARED / name
        files = [path] if path.is_file() else sorted([*path.glob("*.gltf"), *path.glob("*.glb")])
        if files:
            yield name, files[0]


def cases():
    """Yields (name, whether it is in the quick fifth, command lines). A command line is a list of words; `>FILE` names the
    file for its stdout.

    Each case runs in its own folder, and all files that it leaves there are compared.
    """
    number = itertools.count()

    def case(name, *lines, quick=None):
        quick = next(number) % 5 == 0 if quick is None else quick
        return name, quick, [line.split() if isinstance(line, str) else line for line in lines]

    scenes = {}
    for name in OWN:
        path = ROOT / f"scenes/{name}.glb"
        sky = path.with_suffix(".hdr")
        scenes[name] = f"{path}" + (f" --env {sky}" if sky.exists() else "")
    for i, (name, path) in enumerate(strangers()):
        sky = sorted([*SKY.glob("*.hdr"), *SKY.glob("*.exr")])
        # Every third has no environment map here: the program adds its own.
        scenes[name] = f"{path}" + (f" --env {sky[0]} --env-rotate {30 * i}" if i % 3 and sky else "")

    for i, (name, scene) in enumerate(scenes.items()):
        line = RENDER.format(scene) + " --aov all --stats stats.json -o out.exr"
        yield case(f"{name} path embree", f"{line} --spp 160 --threads {1 + i % 2}")
        yield case(f"{name} path obvhs", f"{line} --spp 40 --rays obvhs --threads {2 - i % 2}")
        yield case(f"{name} direct", f"{line} --spp 40 --integrator direct --threads 1")
    for i, (name, balance) in enumerate(itertools.product(
            ["veach", "glossy-sun", "study/window", "many-lights"], BALANCES)):
        line = RENDER.format(scenes[name]) + f" --balance {balance} --stats stats.json -o out.exr --threads 1"
        rays = ["embree", "obvhs"][i // 2 % 2]
        yield case(f"{name} {balance} path", f"{line} --spp 40 --rays {rays} --aov all")
        yield case(f"{name} {balance} direct", f"{line} --spp 160 --integrator direct --seed {i}")

    cornell, veach, sun = (scenes[name] for name in ["cornell", "veach", "glossy-sun"])
    one = RENDER + " -o out.exr --stats stats.json --threads 1 "
    for pilot in ["0.1", "0.8"]:
        yield case(f"pilot {pilot}", one.format(veach) + f"--spp 100 --balance second-order --pilot {pilot}")
    for name in ["gaussian", "box", "blackman-harris"]:
        yield case(f"filter {name}", one.format(cornell) + f"--spp 20 --filter {name}")
    for depth in [1, 2, 3, 20]:
        yield case(f"depth {depth}", one.format(scenes["study/mirrors"]) + f"--spp 20 --max-depth {depth}")
    yield case("environment", one.format(sun) + "--spp 40 --env-strength 0.3 --env-rotate 77 --seed 9")
    yield case("no environment", one.format(f"{ROOT}/scenes/field.glb") + "--spp 40 --no-env")
    yield case("own environment", one.format(f"{ROOT}/scenes/field.glb") + "--spp 40", quick=True)
    yield case("default spp", one.format(f"{ROOT}/scenes/cornell.glb"))
    yield case("noise goal", one.format(cornell) + "--noise 0.2", quick=True)
    yield case("odd numbers", one.format(veach).replace("60x36", "37x29") + "--spp 333 --aov all", quick=True)
    for number_, view in enumerate(["agx", "neutral", "srgb"]):
        yield case(f"preview {view}", one.format(veach) +
                   f"--spp 20 --preview out.png --view {view} --exposure {number_ - 1}")
    for balance in ["progressive", "second-order"]:
        line = one.format(veach).replace("60x36", "70x50") + f"--spp 160 --balance {balance} --aov all "
        yield case(f"crop {balance}", line + "--crop 13,9,50,33", quick=True)
        yield case(f"parts {balance}",
                   *(line.replace("out.exr", f"part{k}.exr") + f"--part {k}/3" for k in [1, 2, 3]),
                   "merge part2.exr part3.exr part1.exr -q -o out.exr", quick=True)
        yield case(f"seeds {balance}",
                   *(line.replace("out.exr", f"seed{k}.exr") + f"--seed {k} --checkpoint 99" for k in [1, 2]),
                   "merge seed1.exr seed2.exr -q -o out.exr")
        if balance == "progressive":  # The paper's pilot is a fraction of all paths: a longer render has another pilot.
            yield case("longer", line.replace("--spp 160", "--spp 128") + "--checkpoint 99",
                       line.replace("--spp 160", "--spp 384") + "--resume")
        long = line.replace("--spp 160", "--spp 768")
        yield case(f"at once {balance}", long + "--checkpoint 99")
        yield case(f"interrupted {balance}", f"INTERRUPT 2 {long} --checkpoint 0.05 --resume",
                   long + "--checkpoint 99 --resume", quick=True)

    a, b = (RENDER.format(veach) + f" --threads 1 --spp {spp} --seed {spp} -o {name}.exr"
            for name, spp in [("a", 32), ("b", 64)])
    yield case("compare", a, b, "compare a.exr b.exr --json --diff difference.exr >compare.json",
               "compare a.exr b.exr -q --diff difference.png", quick=True)
    jobs = ("[defaults]\nsize = '40x30'\nspp = 40\noutput = '{name}-{seed}.exr'\n\n"
            f"[[matrix]]\nscene = ['{ROOT}/scenes/cornell.glb', '{ROOT}/scenes/veach.glb']\nseed = [1, 2]\n")
    yield case("batch", ["WRITE", "jobs.toml", jobs], "batch jobs.toml -q --threads 2 --report report.log", quick=True)

    # inspect loads scenes as render does, and reports more about them.
    for name, scene in scenes.items():
        yield case(f"{name} inspect", f"inspect {scene.split()[0]} --json >inspect.json", quick=True)
    study = "study balance {} --out . --quick --size 32x24 --spp 16,160 --replicas 8 --reference-spp 512 --balance all" \
            " --footprint none"
    for name in ["veach", "study/window"]:
        path = ROOT / f"scenes/{name}.glb"
        line = study.format(path) + " --threads 1 --progress none -q"
        yield case(f"study balance {name}", line, quick=name == "veach")
    yield case("study balance path", study.format(ROOT / "scenes/cornell.glb").replace("16,160", "16") +
               " --integrator path --threads 1 --progress none -q")
    yield case("study stability", "study stability --out . --quick --threads 1 --progress none -q", quick=False)


def run(binary, folder, lines):
    """Runs a case's command lines in its folder."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("SLURM_", "BISMAR_"))}
    for words in lines:
        if words[0] == "WRITE":
            (folder / words[1]).write_text(words[2])
            continue
        interruptions = 0
        if words[0] == "INTERRUPT":
            interruptions, words = int(words[1]), words[2:]
        stdout = next((word[1:] for word in words if word.startswith(">")), None)
        command = [binary] + [word for word in words if not word.startswith(">")]
        for _ in range(max(interruptions, 1)):
            with open(folder / (stdout or "stdout.log"), "w") as out, open(folder / "stderr.log", "w") as err:
                child = subprocess.Popen(command, cwd=folder, stdout=out, stderr=err, env=environment)
                if interruptions:
                    output = folder / words[words.index("-o") + 1]
                    before = modified(output)
                    while child.poll() is None and modified(output) == before:
                        time.sleep(0.005)
                    child.send_signal(signal.SIGTERM)
                code = child.wait()
            if code != (75 if interruptions else 0):
                log = (folder / "stderr.log").read_text()[-2000:]
                raise RuntimeError(f"exit code {code}: bismar {' '.join(command[1:])}\n{log}")


def modified(path):
    return path.stat().st_mtime_ns if path.exists() else None


def results(folder):
    """The comparable contents of a folder by file name: channels as arrays, text as values."""
    found = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".exr":
            found[path.name] = read_exr(path)
        elif path.suffix == ".png":
            found[path.name] = read_png(path)
        elif path.suffix == ".json":
            found[path.name] = steady(json.loads(path.read_text()))
        elif path.suffix == ".csv":
            with open(path, newline="") as file:
                found[path.name] = steady(list(csv.DictReader(file)))
    if not found:
        raise RuntimeError("no file to compare")
    return found


def steady(value):
    if isinstance(value, dict):
        return {key: steady(x) for key, x in value.items() if not UNSTEADY.fullmatch(key)}
    return [steady(x) for x in value] if isinstance(value, list) else value


def read_exr(path):
    """The first part's data window, and its channels as arrays of bits. Reads scan lines and tiles, uncompressed or ZIP."""
    data = path.read_bytes()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630 or version & 0x800:
        raise RuntimeError(f"{path.name}: not an OpenEXR file without deep data")
    several, at, headers = bool(version & 0x1000), 8, []
    while True:
        header = {}
        while data[at]:
            end = data.index(0, at)
            name, at = data[at:end].decode(), end + 1
            at = data.index(0, at) + 1  # its type
            size = struct.unpack_from("<I", data, at)[0]
            header[name] = data[at + 4 : at + 4 + size]
            at += 4 + size
        at += 1
        if header:
            headers.append(header)
        if not several or not header:
            break
    header = headers[0]
    channels, place = [], 0
    while header["channels"][place]:
        end = header["channels"].index(0, place)
        kind = struct.unpack_from("<I", header["channels"], end + 1)[0]
        channels.append((header["channels"][place:end].decode(), kind))
        place = end + 17
    # Bytes of a value: kind 1 is half floats.
    channels = [(name, 2 if kind == 1 else 4) for name, kind in channels]
    pixel = sum(width for _, width in channels)
    x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"])
    width, height, compression = x1 - x0 + 1, y1 - y0 + 1, header["compression"][0]
    lines = {0: 1, 2: 1, 3: 16}.get(compression)
    whole_lines = struct.pack("<IIB", width, lines or 1, 0)
    tile_width, tile_height, levels = struct.unpack("<IIB", header.get("tiles", whole_lines))
    if lines is None or levels:
        raise RuntimeError(f"{path.name}: compression {compression} or mip levels are not supported")
    values = {name: array("H" if size == 2 else "I", bytes(size * width * height)) for name, size in channels}
    count = -(-height // tile_height) * -(-width // tile_width)
    for offset in struct.unpack_from(f"<{count}Q", data, at):
        offset += 4 * several
        if "tiles" in header:
            i, j, _, _, size = struct.unpack_from("<5I", data, offset)
            left, top, chunk = i * tile_width, j * tile_height, data[offset + 20 :][:size]
        else:
            y, size = struct.unpack_from("<iI", data, offset)
            left, top, chunk = 0, y - y0, data[offset + 8 :][:size]
        rows, columns = min(tile_height, height - top), min(tile_width, width - left)
        full = pixel * columns * rows
        if size < full:
            # Bytes are stored as differences, those at even positions first.
            chunk = bytes(itertools.accumulate(zlib.decompress(chunk), lambda a, b: (a + b - 128) & 255))
            half, straight = (full + 1) // 2, bytearray(full)
            straight[0::2], straight[1::2] = chunk[:half], chunk[half:]
            chunk = bytes(straight)
        start = 0
        for row in range(top, top + rows):
            for name, size in channels:
                end, place = start + size * columns, row * width + left
                values[name][place : place + columns] = array(values[name].typecode, chunk[start:end])
                start = end
    return {"window": [x0, y0, x1, y1], **values}


def read_png(path):
    """The header (size and colour type) and the pixels' bytes, row by row. Reads 8 bits, not interlaced."""
    data, at, image, head = path.read_bytes(), 8, b"", b""
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        head += data[at + 8 : at + 8 + size] if kind == b"IHDR" else b""
        image += data[at + 8 : at + 8 + size] if kind == b"IDAT" else b""
        at += 12 + size
    width, height, _, color = struct.unpack(">IIBB", head[:10])
    step = {0: 1, 2: 3, 4: 2, 6: 4}[color]
    stream, rows, above = zlib.decompress(image), array("B"), bytes(width * step)
    for y in range(height):
        kind, *row = stream[y * (width * step + 1) :][: width * step + 1]
        for i in range(len(row)):
            left = row[i - step] if i >= step else 0
            corner = above[i - step] if i >= step else 0
            guess = left + above[i] - corner
            nearest = min((left, above[i], corner), key=lambda x: abs(guess - x))
            row[i] = row[i] + (0, left, above[i], (left + above[i]) // 2, nearest)[kind] & 255
        rows.extend(row)
        above = row
    return {"head": head.hex(), "bytes": rows}


def value(bits, kind="I"):
    return struct.unpack({"I": "<f", "H": "<e"}[kind], struct.pack(f"<{kind}", bits))[0] if kind in "IH" else bits


def differences(old, new, where=""):
    """Yields a line of text for each difference."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in old:
            if key not in new:
                yield f"{where} {key}: missing"
            else:
                yield from differences(old[key], new[key], f"{where} {key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new)):
            yield from differences(a, b, f"{where}[{i}]")
    elif isinstance(old, array) and isinstance(new, array) and len(old) == len(new):
        pairs = [(value(a, old.typecode), value(b, old.typecode)) for a, b in zip(old, new) if a != b]
        if pairs:
            worst = max(pairs, key=lambda pair: abs(pair[0] - pair[1]))
            yield f"{where}: {len(pairs)} of {len(old)} values, largest {worst[0]:.9g} -> {worst[1]:.9g}"
    elif old != new:
        short = lambda x: text if len(text := str(x)) < 60 else text[:50] + "..."
        yield f"{where}: {short(old)} -> {short(new)}"


def extra_channels(old, new):
    """Yields a line for each channel that the record does not have: the same options must write the same channels."""
    for file in old.keys() & new.keys():
        if file.endswith(".exr"):
            yield from (f" {file} {name}: new" for name in new[file].keys() - old[file].keys())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "check"])
    parser.add_argument("binary", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--quick", action="store_true", help="a fifth of the cases")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this regular expression")
    parser.add_argument("--jobs", type=int, default=min(4, len(os.sched_getaffinity(0))), help="cases at a time")
    arguments = parser.parse_args()
    binary, recording = arguments.binary.resolve(), arguments.what == "record"
    wanted = [(name, lines) for name, quick, lines in cases()
              if (quick or not arguments.quick) and re.search(arguments.only, name)]
    start = time.monotonic()

    def one(task):
        name, lines = task
        kept = arguments.folder / name.replace("/", "_").replace(" ", "-")
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            try:
                run(binary, folder, lines)
                new = results(folder)
                if not recording:
                    if not kept.is_dir():
                        return name, [" not in the record"]
                    old = results(kept)
                    return name, [*differences(old, new), *extra_channels(old, new)]
            except (RuntimeError, OSError, ValueError) as error:
                return name, [f" {error}"]
            shutil.rmtree(kept, ignore_errors=True)
            kept.mkdir(parents=True)
            for file in new:
                shutil.copy(folder / file, kept)
            return name, []

    failed = 0
    # The last cases are the longest: they start first.
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for name, problems in pool.map(one, reversed(wanted)):
            failed += bool(problems)
            for line in problems[:12]:
                print(f"{name}:{line}")
            if len(problems) > 12:
                print(f"{name}: and {len(problems) - 12} more")
    print(f"{len(wanted)} cases, {failed} {'failed' if recording else 'differ'}, {time.monotonic() - start:.0f} s")
    sys.exit(1 if failed or not wanted else 0)


if __name__ == "__main__":
    main()
