#!/usr/bin/env python3
"""How much a sequence's frames share: sequences.py BISMAR SCENE... [--frames N] > table.md

Renders frames 0 to N - 1 (240) of each scene at 64x36 and 4 paths a pixel, once as so many commands and once as one
sequence, and holds their pictures together bit for bit. Two more scenes are made here: `textures` (two of 2048x2048
texels on what stands still, beside a triangle that moves) and `geometry` (300,000 triangles that stand still, under a
camera that moves). Memory is the peak of any process, of a tenth of the frames and of all.
"""

import argparse
import json
import math
import os
import random
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

FLAGS = ["--size", "64x36", "--spp", "4", "--fps", "24", "-q"]


def png(side, seed):
    noise = random.Random(seed)
    rows = b"".join(b"\0" + noise.randbytes(side * 3) for _ in range(side))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b"")


def glb(path, side, rows):
    """A plate of rows x rows x 2 triangles with textures of `side`, if any; a triangle or, without textures, the camera moves."""
    data, views, accessors = b"", [], []

    def view(data_of):
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(data_of)})
        data += data_of + bytes(-len(data_of) % 4)
        return len(views) - 1

    def floats(values, shape, width):
        accessors.append({"bufferView": view(struct.pack(f"<{len(values)}f", *values)), "componentType": 5126,
                          "count": len(values) // width, "type": shape})
        return len(accessors) - 1

    n = rows + 1
    grid = [(x / rows * 2 - 1, y / rows * 2 - 1) for y in range(n) for x in range(n)]
    plate = floats([c for x, y in grid for c in (x, y, 0.1 * math.sin(9 * x) * math.sin(7 * y))], "VEC3", 3)
    uv = floats([c for x, y in grid for c in (x, y)], "VEC2", 2)
    quads = [(y * n + x, y * n + x + 1, y * n + x + n + 1, y * n + x + n) for y in range(rows) for x in range(rows)]
    indices = [i for a, b, c, d in quads for i in (a, b, c, a, c, d)]
    accessors.append({"bufferView": view(struct.pack(f"<{len(indices)}I", *indices)), "componentType": 5125,
                      "count": len(indices), "type": "SCALAR"})
    index = len(accessors) - 1
    small = floats([-0.2, 0, 0.3, 0.2, 0, 0.3, 0, 0.3, 0.3], "VEC3", 3)
    times, places = floats([0, 10], "SCALAR", 1), floats([0, 0, 3, 0.5, 0, 3] if not side else [-1, 0, 0, 1, 0, 0], "VEC3", 3)
    images = [{"bufferView": view(png(side, seed)), "mimeType": "image/png"} for seed in (1, 2)] if side else []
    material = {"pbrMetallicRoughness": {"metallicFactor": 0}}
    if side:
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
        material["emissiveTexture"], material["emissiveFactor"] = {"index": 1}, [1, 1, 1]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0}, {"mesh": 1}, {"camera": 0, "translation": [0, 0, 3]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": plate, "TEXCOORD_0": uv}, "indices": index, "material": 0}]},
                   {"primitives": [{"attributes": {"POSITION": small}}]}],
        "materials": [material],
        "animations": [{"samplers": [{"input": times, "output": places}],
                        "channels": [{"sampler": 0, "target": {"node": 1 if side else 2, "path": "translation"}}]}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}],
    }
    if side:
        document["textures"] = [{"source": 0}, {"source": 1}]
        document["images"] = images
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON") + text
                     + struct.pack("<I4s", len(data), b"BIN\0") + data)


def run(line):
    """Wall seconds, CPU seconds, and MiB at the peak of any process."""
    begin = time.monotonic()
    process = subprocess.Popen(line)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{line}: {status}")
    return time.monotonic() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def beauty(path):
    """The file without its header, which holds times."""
    parts = subprocess.run([program, "compare", path[0], path[1], "--json"], capture_output=True, check=True).stdout
    return json.loads(parts)["rmse"]


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("program")
parser.add_argument("scenes", nargs="*")
parser.add_argument("--frames", type=int, default=240)
parser.add_argument("--make", type=Path, help=argparse.SUPPRESS)
arguments = parser.parse_args()
if arguments.make:
    glb(arguments.make / "textures.glb", 2048, 1)
    glb(arguments.make / "geometry.glb", 0, 388)
    sys.exit()
program, count = arguments.program, arguments.frames
print("| scene | single commands, s (CPU) | sequence, s (CPU) | frames an hour, times | MiB, a tenth and all |")
print("| --- | --- | --- | --- | --- |")
with tempfile.TemporaryDirectory() as folder:
    folder = Path(folder)
    # By another process: what a process was large before it became another one counts as that one's memory.
    subprocess.run([sys.executable, __file__, "-", "--make", folder], check=True)
    for scene in [*arguments.scenes, folder / "textures.glb", folder / "geometry.glb"]:
        single = [0.0, 0.0]
        for frame in range(count):
            wall, cpu, _ = run([program, "render", scene, "--frame", str(frame), "--seed-per-frame", *FLAGS,
                                "-o", folder / f"single.{frame:04}.exr"])
            single[0] += wall
            single[1] += cpu
        few = run([program, "render", scene, "--frames", f"0-{count // 10 - 1}", *FLAGS, "-o", folder / "few.####.exr"])
        wall, cpu, peak = run([program, "render", scene, "--frames", f"0-{count - 1}", *FLAGS, "-o", folder / "all.####.exr"])
        for frame in range(count):
            if beauty([folder / f"{name}.{frame:04}.exr" for name in ("single", "all")]) != 0:
                sys.exit(f"{scene}: frame {frame} differs")
        for old in folder.glob("*.exr"):
            old.unlink()
        name = Path(scene).stem
        print(f"| {name} | {single[0]:.1f} ({single[1]:.1f}) | {wall:.1f} ({cpu:.1f}) | {single[0] / wall:.2f} |"
              f" {few[2]:.0f}, {peak:.0f} |", flush=True)
