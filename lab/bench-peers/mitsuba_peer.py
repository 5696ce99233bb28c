"""Mitsuba 3 as a peer. `mitsuba_peer.py '{"folder": DIR, "scene": NAME, "size": N, "depth": N, "roulette": N, "flatten": false}'`

Prints {"setup": seconds}, then for each line `SPP SEED FILE.npy` on standard input renders and prints what that took.
"""

import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np
import mitsuba_scene
import scenes
from mitsuba_scene import rgb

import mitsuba as mi

ARGS = json.loads(sys.argv[1])
START = time.perf_counter()
mi.set_variant("llvm_ad_rgb")


def bsdf(material):
    if material.metallic:
        # Schlick's Fresnel as ours, but separable Smith masking, where ours is height-correlated.
        inner = {"type": "principled", "base_color": rgb(material.color), "metallic": 1.0, "roughness": material.roughness}
    else:
        inner = {"type": "diffuse", "reflectance": rgb(material.color)}
    return {"type": "twosided", "nested": inner}


def mesh(vertices, triangles, material):
    return mitsuba_scene.mesh(vertices, triangles, bsdf(material), material.emission)


def placed(name, shape):
    """A mesh that is used more than once: instances, or all in one when flattened."""
    if ARGS["flatten"]:
        steps = np.arange(len(shape.places))[:, None, None] * len(shape.vertices)
        vertices = np.concatenate([place.apply(shape.vertices) for place in shape.places])
        return {name: mesh(vertices, (shape.triangles[None] + steps).reshape(-1, 3), shape.material)}
    out = {name: {"type": "shapegroup", "shape": mesh(shape.vertices, shape.triangles, shape.material)}}
    for index, place in enumerate(shape.places):
        to_world = mi.ScalarTransform4f().translate(place.move).rotate([0, 1, 0], np.degrees(place.angle)).scale(place.scale)
        out[f"{name}_{index}"] = {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": name}}
    return out


def sky():
    """Mitsuba puts the first and last row of texels on the poles, we half a texel away from them: twice as many rows,
    one more, show the same picture."""
    ours = scenes.sky()
    rows = np.clip(np.arange(2 * len(ours) + 1) / 2 - 0.5, 0, len(ours) - 1)
    low, part = np.floor(rows).astype(int), (rows % 1)[:, None, None]
    theirs = ours[low] * (1 - part) + ours[np.minimum(low + 1, len(ours) - 1)] * part
    to_world = mi.ScalarTransform4f().rotate([0, 1, 0], 90)
    return {"type": "envmap", "bitmap": mi.Bitmap(theirs.astype(np.float32)), "to_world": to_world}


def generated(scene):
    """What mitsuba_scene.load returns of a file."""
    out = {}
    for index, shape in enumerate(scene.meshes):
        name = f"mesh{index}"
        out |= placed(name, shape) if shape.places else {name: mesh(shape.vertices, shape.triangles, shape.material)}
    return scene.yfov, scene.camera(), out | ({"sky": sky()} if scene.sky else {})


def load():
    name, size = ARGS["scene"], ARGS["size"]
    own = scenes.SCENES.get(name)
    yfov, camera, content = generated(own()) if own else mitsuba_scene.load(Path(ARGS["folder"], f"{name}.glb"))
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    out = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": ARGS["depth"], "rr_depth": ARGS["roulette"]},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(yfov)),
            "fov_axis": "y",
            # Mitsuba's camera looks along +z, glTF's along -z.
            "to_world": mi.ScalarTransform4f(camera @ np.diag([-1.0, 1.0, -1.0, 1.0])),
            "film": film,
            "sampler": {"type": "independent"},
        },
    }
    return mi.load_dict(out | content)


scene = load()
np.array(mi.render(scene, spp=1))
print(json.dumps({"setup": time.perf_counter() - START, "version": mi.__version__}), flush=True)
for line in sys.stdin:
    spp, seed, path = line.split()
    start, cpu = time.perf_counter(), time.process_time()
    image = np.array(mi.render(scene, spp=int(spp), seed=int(seed)))
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    np.save(path, image)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"seconds": seconds, "cpu": cpu, "peak_mib": peak // 1024}), flush=True)
os._exit(0)  # its threads do not always end
