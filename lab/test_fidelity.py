#!/usr/bin/env python3
"""Checks `fidelity.py` on a suite of its own: pictures of cameras whose matrices are written by hand.

    test_fidelity.py [PROGRAM]    exits with 1 if anything is not as it must be

Needs what fidelity.py needs (target/pictures/bin/python) and target/release/bismar, or PROGRAM.
"""

import base64
import json
import math
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Sine and cosine of 45 degrees.
S = math.sqrt(0.5)
# From the right and from above: right, up and backward are the columns of the matrix.
TURNED = [[S, 0, S, 0.25 + 3 * S], [0, 1, 0, 0.5], [-S, 0, S, 3 * S], [0, 0, 0, 1]]
ABOVE = [[1, 0, 0, 0.25], [0, S, S, 0.5 + 3 * S], [0, -S, S, 3 * S], [0, 0, 0, 1]]
SIZE = {"width": 48, "height": 40}
# Of the suite's configuration: name, model, environment, orbit.
SCENARIOS = [("Above", "Thing", "field", 0, 45), ("Elsewhere", "Thing", "field", -45, 90), ("Two", "Thing", "field", 0, 45),
             ("One", "Thing", "field", 0, 45), ("NoModel", "Other", "field", 45, 90), ("NoSky", "Thing", "other", 45, 90),
             ("NoGolden", "Thing", "field", 45, 90)]


def thing():
    """A triangle that is seen from both sides."""
    points = struct.pack("<9f", 0, 0, 0, 1, 0, 0.3, 0, 1, 0)
    return {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}], "materials": [{"doubleSided": True}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0.3]}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64," + base64.b64encode(points).decode()}]}


def main():
    bismar = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/release/bismar").resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "models/Thing").mkdir(parents=True)
        (folder / "models/Thing/Thing.gltf").write_text(json.dumps(thing()))
        (folder / "skies").mkdir()
        for sky in ("field.hdr", "lightroom_14b.hdr"):
            shutil.copy(ROOT / "scenes/field.hdr", folder / "skies" / sky)
        goldens = folder / "suite/public/thumbnails/goldens"

        def golden(name, matrix, peers=("blender-cycles", "vray")):
            cameras = {"camera_angle_y": math.pi / 4, "w": 48, "h": 40, "frames": [{"file_path": "a", "transform_matrix": matrix}]}
            (folder / "cameras.json").write_text(json.dumps(cameras))
            flags = ("render models/Thing/Thing.gltf --cameras cameras.json --camera a --env skies/field.hdr --transparent --filter "
                     "box --spp 16 --view aces --exposure 0 -q -o a.exr --preview a.webp")
            subprocess.run([bismar, *flags.split()], cwd=folder, check=True)
            (goldens / f"khronos-{name}").mkdir(parents=True, exist_ok=True)
            for peer in peers:
                shutil.copy(folder / "a.webp", goldens / f"khronos-{name}" / f"{peer}-golden.thumb.webp")

        for name, matrix in [("Turned", TURNED), ("Above", ABOVE), ("Elsewhere", ABOVE), ("NoModel", TURNED), ("NoSky", TURNED)]:
            golden(name, matrix)
        # Two that disagree, and one of them alone.
        golden("Two", ABOVE, ["blender-cycles"])
        golden("Two", TURNED, ["vray"])
        golden("One", TURNED, ["vray"])
        # The suite's defaults: its light, its field of view, a view from the side.
        scenarios = [{"name": "khronos-Turned", "model": "Thing.gltf", "dimensions": SIZE, "target": {"x": 0.25, "y": 0.5},
                      "orbit": {"theta": 45, "radius": 3}}]
        scenarios += [{"name": f"khronos-{name}", "model": f"../Models/{model}/glTF/{model}.gltf", "lighting": f"../{sky}.hdr",
                       "dimensions": SIZE, "target": {"x": 0.25, "y": 0.5, "z": 0}, "verticalFoV": 45, "renderSkybox": False,
                       "orbit": {"theta": theta, "phi": phi, "radius": 3}} for name, model, sky, theta, phi in SCENARIOS]
        (folder / "config.json").write_text(json.dumps({"scenarios": scenarios}))

        def run(suite):
            flags = f"--suite {suite} --config config.json --models models --environments skies --out out --spp 16 --bismar"
            return subprocess.run([sys.executable, ROOT / "lab/fidelity.py", *flags.split(), bismar], cwd=folder,
                                  capture_output=True, text=True)

        done = run("suite")
        assert done.returncode == 0, done.stderr
        rows = {row["name"]: row for row in json.loads((folder / "out/results.json").read_text())}
        for name in ("Turned", "Above"):
            for who in ("bismar", "blender-cycles", "vray"):
                assert (rows[name]["flip"][who], rows[name]["overlap"][who]) == (0, 1), (name, who, rows[name])
        assert rows["Elsewhere"]["flip"]["bismar"] > 0.01 and rows["Elsewhere"]["overlap"]["bismar"] < 0.9, rows["Elsewhere"]
        assert rows["Elsewhere"]["overlap"]["vray"] == 1, rows["Elsewhere"]
        # Each of the others is compared with the mean of those that are left.
        one = rows["One"]["flip"]["bismar"]
        assert one > 0.01 and rows["Two"]["flip"]["blender-cycles"] == one and "vray" not in rows["One"]["flip"], rows
        assert rows["Two"]["flip"]["bismar"] < one, rows
        # Without its light only the silhouette is compared: of another picture, rendered under an even sky.
        assert "bismar" not in rows["NoSky"]["flip"] and rows["NoSky"]["overlap"]["bismar"] == 1, rows["NoSky"]
        for line in ("| Elsewhere | **0.", "| Turned | 0.000 | 0.000 | 0.000 |", "- its model is in no folder of --models: NoModel.",
                     "- FLIP only: other.hdr is in no folder of --environments: NoSky.", "- no golden picture in the suite: NoGolden."):
            assert line in done.stdout, f"{line}\n{done.stdout}"
        assert "khronos-Elsewhere/strip.png" in (folder / "out/index.html").read_text()
        done = run("nowhere")
        assert done.returncode and "--suite is a clone of" in done.stderr, done.stderr
    print("fidelity.py is as it must be")


if __name__ == "__main__":
    main()
