"""Compares the memory that a render says it needs with what it takes, over about forty kinds of scene and settings.

    reliability_memory.py BINARY [WORD...]     prints one line for each kind whose name holds one of the words

`said` is the estimate that `render -v` logs before it decodes anything, `taken` the peak resident memory of the process and
the processes that it starts. Needs nothing but Python 3.9.
"""

import array
import json
import math
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MIB = 1 << 20
# What the estimate may be above what is taken: a third, and this many bytes of the process itself.
SHARE, BASE = 4 / 3, 24 * MIB


class Scene:
    """A glTF document with its buffer, built part by part."""

    def __init__(self):
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
                     "materials": [], "accessors": [], "bufferViews": []}
        self.bin = bytearray()

    def view(self, data, **more):
        self.bin += b"\0" * (-len(self.bin) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.bin), "byteLength": len(data), **more})
        self.bin += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, data, kind, component=5126, **more):
        """Elements from bytes; `data` may be a count alone, of elements without data."""
        item = {"componentType": component, "type": kind, **more}
        size = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind] * {5126: 4, 5125: 4, 5123: 2, 5121: 1}[component]
        if isinstance(data, int):
            item["count"] = data
        else:
            item.update(bufferView=self.view(bytes(data)), count=len(data) // size)
        if kind == "VEC3" and component == 5126:
            item.update(min=[-1e3] * 3, max=[1e3] * 3)
        self.json["accessors"].append(item)
        return len(self.json["accessors"]) - 1

    def mesh(self, primitive, **more):
        self.json["meshes"].append({"primitives": [primitive], **more})
        return len(self.json["meshes"]) - 1

    def node(self, shown=True, **more):
        self.json["nodes"].append(more)
        index = len(self.json["nodes"]) - 1
        if shown:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def material(self, **more):
        self.json["materials"].append(more)
        return len(self.json["materials"]) - 1

    def picture(self, data, mime):
        image = {"bufferView": self.view(data), "mimeType": mime}
        self.json.setdefault("images", []).append(image)
        self.json.setdefault("textures", []).append({"source": len(self.json["images"]) - 1})
        return {"index": len(self.json["textures"]) - 1}

    def save(self, path):
        document = {key: value for key, value in self.json.items() if value != []}
        if self.bin:
            document["buffers"] = [{"byteLength": len(self.bin)}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.bin) + b"\0" * (-len(self.bin) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if binary:
            chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def floats(values):
    return array.array("f", values).tobytes()


def grid(scene, n, attributes=(), targets=0, strip=False, **more):
    """A rolling field of n x n quads as a primitive, with the named attributes."""
    points, normals, coordinates = array.array("f"), array.array("f"), array.array("f")
    for y in range(n + 1):
        for x in range(n + 1):
            u, v = x / n, y / n
            points.extend((2 * u - 1, 0.1 * math.sin(9 * u) * math.cos(7 * v), 2 * v - 1))
            normals.extend((0, 1, 0))
            coordinates.extend((u, v))
    indices = array.array("I")
    for y in range(n):
        if strip:
            # Rows are joined by triangles without area.
            row = [i for x in range(n + 1) for i in (y * (n + 1) + x, (y + 1) * (n + 1) + x)]
            indices.extend([row[0], *row, row[-1]])
            continue
        for x in range(n):
            a = y * (n + 1) + x
            indices.extend((a, a + n + 1, a + 1, a + 1, a + n + 1, a + n + 2))
    count = (n + 1) ** 2
    data = {"POSITION": (points, "VEC3"), "NORMAL": (normals, "VEC3"), "TEXCOORD_0": (coordinates, "VEC2"),
            "COLOR_0": (array.array("f", [0.5]) * (4 * count), "VEC4")}
    primitive = {"attributes": {name: scene.accessor(data[name][0].tobytes(), data[name][1])
                                for name in ("POSITION", *attributes)},
                 "indices": scene.accessor(indices.tobytes(), "SCALAR", 5125), **more}
    if targets:
        primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]} for _ in range(targets)]
    if strip:
        primitive["mode"] = 5
    return primitive


BOX = [(x, y, z) for x in (-.5, .5) for y in (-.5, .5) for z in (-.5, .5)]
SIDES = [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]


def box(scene, **more):
    return {"attributes": {"POSITION": scene.accessor(floats(x for p in BOX for x in p), "VEC3")},
            "indices": scene.accessor(array.array("H", SIDES).tobytes(), "SCALAR", 5123), **more}


def png(width, height, channels=3, bits=8, noise=True):
    """A PNG picture of noise, or of one colour."""
    size = width * channels * bits // 8
    chance = random.Random(1)
    row = lambda: b"\0" + (chance.randbytes(size) if noise else b"\x80" * size)
    packed = zlib.compressobj(1)
    data = b"".join(packed.compress(row()) for _ in range(height)) + packed.flush()
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)) \
        + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def hdr(width, height):
    """A Radiance picture, not compressed."""
    chance = random.Random(2)
    row = b"".join(bytes((chance.randrange(128, 256), chance.randrange(128), 90, 128)) for _ in range(width))
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + row * height


def animate(scene, nodes, seconds=1.0):
    """Every node moves up and down, on a curve of which no part is a line."""
    time_of = scene.accessor(floats([0, seconds]), "SCALAR", min=[0], max=[seconds])
    # Of each key: the tangent before it, the value, and the tangent after it.
    value = scene.accessor(floats([0] * 9 + [0, -9, 0, 0, 1, 0, 0, -9, 0]), "VEC3")
    scene.json["animations"] = [{"samplers": [{"input": time_of, "output": value, "interpolation": "CUBICSPLINE"}],
                                 "channels": [{"sampler": 0, "target": {"node": n, "path": "translation"}} for n in nodes]}]


def textured(folder, name, data, mime, **more):
    scene = Scene()
    material = scene.material(pbrMetallicRoughness={"baseColorTexture": scene.picture(data, mime)}, **more)
    scene.node(mesh=scene.mesh(grid(scene, 4, ("NORMAL", "TEXCOORD_0"), material=material)))
    scene.save(folder / name)


def meshes(folder):
    """Scenes of triangles, instances, motion and lamps; pairs of a name and the flags."""
    def saved(name, make):
        scene = Scene()
        make(scene)
        scene.save(folder / name)
        return name

    def field(n, attributes=(), **more):
        return lambda s: s.node(mesh=s.mesh(grid(s, n, attributes, **more)))

    small = "--size 64x64 --spp 1 --sky"
    yield "a mesh of 20,000 triangles", saved("m1.glb", field(100)), small
    yield "a mesh of 500,000 triangles", saved("m2.glb", field(500)), small
    yield "a mesh of 500,000 triangles, obvhs", "m2.glb", small + " --rays obvhs"
    yield "a mesh of 2,000,000 triangles", saved("m3.glb", field(1000)), small
    yield "with normals, coordinates and colours", saved("m4.glb", field(500, ("NORMAL", "TEXCOORD_0", "COLOR_0"))), small

    def mapped(s):
        material = s.material(normalTexture=s.picture(png(8, 8), "image/png"))
        s.node(mesh=s.mesh(grid(s, 500, ("NORMAL", "TEXCOORD_0"), material=material)))
    yield "with a normal map, whose tangents are made", saved("m5.glb", mapped), small
    yield "a strip of 500,000 triangles", saved("m6.glb", field(500, strip=True)), small

    def soup(s):
        chance = random.Random(5)
        where = lambda: [chance.uniform(-1, 1) for _ in range(3)]
        points = array.array("f")
        for _ in range(300_000):
            middle = where()
            points.extend(m + 0.02 * d for _ in range(3) for m, d in zip(middle, where()))
        s.node(mesh=s.mesh({"attributes": {"POSITION": s.accessor(points.tobytes(), "VEC3")}}))
    yield "300,000 scattered triangles without indices", saved("m8.glb", soup), small
    yield "300,000 scattered triangles, obvhs", "m8.glb", small + " --rays obvhs"

    def many(s):
        primitives = [box(s) for _ in range(20000)]
        for i, primitive in enumerate(primitives):
            s.node(mesh=s.mesh(primitive), translation=[i % 150, 0, i // 150])
    yield "20,000 meshes of a box", saved("m7.glb", many), small

    def nodes(s):
        mesh = s.mesh(box(s))
        for i in range(100_000):
            s.node(mesh=mesh, translation=[i % 300, 0, i // 300], name=f"box {i}")
    yield "100,000 nodes of a box", saved("i1.glb", nodes), small

    def instanced(count, data, primitive):
        def make(s):
            places = floats(x for i in range(count) for x in (i % 700, 0, i // 700)) if data else count
            where = {"TRANSLATION": s.accessor(places, "VEC3")}
            s.node(mesh=s.mesh(primitive(s)), extensions={"EXT_mesh_gpu_instancing": {"attributes": where}})
            s.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
        return make
    yield "500,000 instances of a box", saved("i2.glb", instanced(500_000, True, box)), small
    yield "500,000 instances of a box, obvhs", "i2.glb", small + " --rays obvhs"
    yield "1,000,000 instances by a count without data", saved("i3.glb", instanced(1_000_000, False, box)), small

    def lamp(s):
        material = s.material(emissiveFactor=[1, 1, 1])
        return grid(s, 7, material=material)
    yield "a lamp of 98 triangles, 20,000 times without data", saved("l1.glb", instanced(20_000, False, lamp)), small
    yield "a lamp of 98 triangles, 2,000 times", saved("l2.glb", instanced(2_000, True, lamp)), small
    yield "a lamp of 500,000 triangles", saved("l3.glb", lambda s: s.node(mesh=s.mesh(
        grid(s, 500, material=s.material(emissiveFactor=[1, 1, 1]))))), small

    def moving(count):
        def make(s):
            mesh = s.mesh(box(s))
            animate(s, [s.node(mesh=mesh, translation=[i % 100, 0, i // 100]) for i in range(count)])
        return make
    yield "2,000 nodes that move, 128 steps", saved("a1.glb", moving(2000)), small + " --frame 3 --shutter 0,1 --motion-steps 128"
    yield "20,000 nodes that move, 128 steps", saved("a2.glb", moving(20_000)), small + " --frame 3 --shutter 0,1 --motion-steps 128"
    yield "100,000 nodes that move", saved("a3.glb", moving(100_000)), small + " --frame 3 --shutter 0,1"

    def skinned(n):
        def make(s):
            primitive = grid(s, n, ("NORMAL",))
            count = (n + 1) ** 2
            primitive["attributes"]["JOINTS_0"] = s.accessor(bytes([0, 1, 0, 0]) * count, "VEC4", 5121)
            primitive["attributes"]["WEIGHTS_0"] = s.accessor(floats([.5, .5, 0, 0]) * count, "VEC4")
            joints = [s.node(), s.node()]
            s.json["skins"] = [{"joints": joints}]
            s.node(mesh=s.mesh(primitive), skin=0)
            animate(s, joints)
        return make
    yield "a skin of 300 x 300, 128 steps", saved("a4.glb", skinned(300)), small + " --frame 3 --shutter 0,1 --motion-steps 128"
    yield "a skin of 300 x 300, 8 steps", "a4.glb", small + " --frame 3 --shutter 0,1 --motion-steps 8"

    def morphed(s):
        s.node(mesh=s.mesh(grid(s, 300, ("NORMAL",), targets=8), weights=[0.1] * 8))
    yield "a mesh with eight morph targets", saved("a5.glb", morphed), small
    yield "a mesh with eight morph targets by counts", saved("a6.glb", lambda s: s.node(mesh=s.mesh(
        {**box(s), "attributes": {"POSITION": s.accessor(3_000_000, "VEC3")}, "targets": [
            {"POSITION": s.accessor(3_000_000, "VEC3")} for _ in range(8)]}, weights=[0.1] * 8))), small


def pictures(folder):
    """Textures and environments."""
    small = "--size 64x64 --spp 1"
    def saved(name, *rest, **more):
        if not (folder / name).exists():
            textured(folder, name, *rest, **more)
        return name
    yield "a PNG texture of 4096 x 4096", saved("t1.glb", png(4096, 4096), "image/png"), small + " --sky"
    yield "a PNG texture of 8192 x 8192 of one colour", saved("t2.glb", png(8192, 8192, noise=False), "image/png"), small + " --sky"
    yield "a PNG texture with alpha, 4096 x 4096", saved("t3.glb", png(4096, 4096, 4), "image/png", alphaMode="BLEND"), small + " --sky"
    yield "a PNG texture of 16 bits, 2048 x 2048", saved("t4.glb", png(2048, 2048, 3, 16), "image/png"), small + " --sky"
    (folder / "e1.hdr").write_bytes(hdr(4096, 2048))
    (folder / "e2.hdr").write_bytes(hdr(8192, 4096))
    yield "a sky of 4096 x 2048", "cornell.glb", small + " --env e1.hdr"
    yield "a sky of 4096 x 2048, --balance half", "cornell.glb", small + " --env e1.hdr --balance half"
    yield "a sky of 8192 x 4096, --balance half", "cornell.glb", small + " --env e2.hdr --balance half"


def settings(folder):
    """Pictures by size, columns, threads and pre-passes."""
    c = "cornell.glb"
    yield "64 x 64", c, "--size 64x64 --spp 4"
    yield "64 x 64, 1 thread", c, "--size 64x64 --spp 4 --threads 1"
    yield "64 x 64, 16 threads", c, "--size 64x64 --spp 64 --threads 16"
    yield "960 x 540", c, "--spp 2"
    yield "1920 x 1080", c, "--size 1920x1080 --spp 1"
    yield "1920 x 1080 of a real scene", "show.glb", "--size 1920x1080 --spp 1"
    yield "1920 x 1080 with a PNG", c, "--size 1920x1080 --spp 1 --preview a.png"
    yield "3840 x 2160", c, "--size 3840x2160 --spp 1"
    yield "1280 x 720, all AOVs", c, "--size 1280x720 --spp 1 --aov all"
    yield "1280 x 720, all AOVs, --checkpoint", c, "--size 1280x720 --spp 1 --aov all --checkpoint 900"
    yield "1280 x 720, 64 spp, --checkpoint", c, "--size 1280x720 --spp 8 --checkpoint 900"
    yield "1280 x 720, --balance half", c, "--size 1280x720 --spp 1 --balance half"
    yield "1280 x 720, --guiding on", c, "--size 1280x720 --spp 16 --guiding on"
    (folder / "many.glb").write_bytes((ROOT / "scenes/many-lights.glb").read_bytes())
    yield "640 x 360, learned lights", "many.glb", "--size 640x360 --spp 4"
    # Rooms with indirect light, where paths are guided; a part of few tiles shows the pre-pass alone.
    for name in ("ajar", "shade"):
        (folder / f"{name}.glb").write_bytes((ROOT / f"scenes/study/{name}.glb").read_bytes())
    yield "a part of 640 x 360, guided, learned lights", "ajar.glb", "--size 640x360 --spp 64 --part 1/64"
    yield "a part of 1280 x 720, guided", "shade.glb", "--size 1280x720 --spp 16 --part 1/64"
    yield "480 x 270, guided", "ajar.glb", "--size 480x270 --spp 16 --guiding on"
    yield "1280 x 720, --adaptive", c, "--size 1280x720 --spp 4 --adaptive"
    yield "a crop of 16 x 16 of 4096 x 4096, adaptive", c, "--size 4096x4096 --crop 0,0,16,16 --spp 16 --guiding off"
    yield "a crop of 256 x 256 of 8192 x 8192", c, "--size 8192x8192 --crop 0,0,256,256 --spp 1"
    yield "part 1/4 of 1920 x 1080", c, "--size 1920x1080 --spp 4 --part 1/4"
    scene = Scene()
    scene.json["cameras"] = [{"type": "perspective", "perspective": {"aspectRatio": 0.25, "yfov": 1, "znear": 0.1}}]
    scene.node(mesh=scene.mesh(grid(scene, 20)))
    scene.node(camera=0, translation=[0, 1, 4])
    scene.save(folder / "tall.glb")
    yield "a camera of aspect 1/4, all AOVs", "tall.glb", "--spp 1 --aov all --sky"
    oidn = os.environ.get("BISMAR_OIDN")
    if oidn:
        yield "1024 x 1024, --denoise oidn", c, "--size 1024x1024 --spp 1 --denoise oidn"
        yield "256 x 256, --denoise oidn", c, "--size 256x256 --spp 1 --denoise oidn"


def kinds(folder):
    """Triples: a name, the scene, the flags."""
    (folder / "show.glb").write_bytes((ROOT / "scenes/showpiece.glb").read_bytes())
    (folder / "cornell.glb").write_bytes((ROOT / "scenes/cornell.glb").read_bytes())
    yield from settings(folder)
    yield from meshes(folder)
    yield from pictures(folder)


def tree(process):
    """A process and those that it has started."""
    found = [process]
    try:
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in (task / "children").read_text().split():
                found += tree(int(child))
    except OSError:
        pass
    return found


def resident(process):
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0


def measure(bismar, folder, scene, flags):
    """Exit code, what was said to be needed and what was taken in bytes, seconds, and the standard error."""
    words = ["render", scene, *flags.split(), "-o", "out.exr", "--stats", "out.json", "-v"]
    if "--threads" not in words:
        words += ["--threads", "2"]
    (folder / "out.json").unlink(missing_ok=True)
    began = time.monotonic()
    with open(folder / "said", "w+b") as said:
        child = subprocess.Popen([bismar, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=said)
        most = 0
        while child.poll() is None:
            # The peak of the process is known afterwards, too, but not that of it and its children together.
            most = max(most, sum(resident(process) for process in tree(child.pid)))
            time.sleep(0.01)
        said.seek(0)
        text = said.read().decode(errors="replace")
    if child.returncode == 0:
        most = max(most, json.loads((folder / "out.json").read_text())["peak_memory_bytes"])
    need = re.search(r"needs about (\d+) MiB", text)
    return child.returncode, int(need[1]) * MIB if need else 0, most, time.monotonic() - began, text


def estimates(bismar, folder):
    """A render says what memory it needs before it decodes anything. That is at least what it takes, and at most a third more,
    apart from 24 MiB."""
    rows, low, high = 0, [], []
    for name, scene, flags in kinds(folder):
        code, said, taken, _, text = measure(bismar, folder, scene, flags)
        rows += 1
        remark = f"{name}: {said >> 20} MiB said, {taken >> 20} taken"
        if code not in (0, 65) or said < taken:
            low.append(remark if code in (0, 65) else f"{name}: exit {code}")
        elif code == 0 and said > SHARE * taken + BASE:
            high.append(remark)
    return [("kinds of scene: more is taken than said", rows, len(low), "; ".join(low)),
            ("more is said than 4/3 of what is taken, plus 24 MiB", rows, len(high), "; ".join(high))]


SECTIONS = {"Memory that a render says it needs": estimates}


def main():
    bismar, *wanted = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        for name, scene, flags in kinds(Path(folder)):
            if wanted and not any(word in name for word in wanted):
                continue
            code, said, taken, seconds, text = measure(os.path.abspath(bismar), Path(folder), scene, flags)
            fits = "" if taken <= said <= SHARE * taken + BASE else "LOW" if said < taken else "high"
            print(f"{said / MIB:7.0f} {taken / MIB:7.0f} {said / max(taken, 1):5.2f} {seconds:6.1f} s {code} {fits:4} {name}", flush=True)
            if code:
                print("   ", text.strip().splitlines()[-1][:300])


if __name__ == "__main__":
    main()
