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
import public
import scenes

import mitsuba as mi

ARGS = json.loads(sys.argv[1])
START = time.perf_counter()
mi.set_variant("llvm_ad_rgb")


def rgb(value):
    return {"type": "rgb", "value": [float(x) for x in value]}


def bsdf(material):
    if material.metallic:
        # Schlick's Fresnel as ours, but separable Smith masking, where ours is height-correlated.
        inner = {"type": "principled", "base_color": rgb(material.color), "metallic": 1.0, "roughness": material.roughness}
    else:
        inner = {"type": "diffuse", "reflectance": rgb(material.color)}
    return mi.load_dict({"type": "twosided", "nested": inner})


def mesh(vertices, triangles, material):
    properties = mi.Properties()
    properties["bsdf"] = bsdf(material)
    properties["face_normals"] = True
    if material.emission is not None:
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(material.emission)})
    out = mi.Mesh("mesh", len(vertices), len(triangles), props=properties)
    values = mi.traverse(out)
    values["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    values["faces"] = np.ascontiguousarray(triangles, np.uint32).ravel()
    values.update()
    return out


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


def load():
    name, size = ARGS["scene"], ARGS["size"]
    integrator = {"type": "path", "max_depth": ARGS["depth"], "rr_depth": ARGS["roulette"]}
    if name not in scenes.SCENES:
        return mi.load_dict(public.load(Path(ARGS["folder"], f"{name}.glb"), size) | {"integrator": integrator})
    scene = scenes.SCENES[name]()
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    out = {
        "type": "scene",
        "integrator": integrator,
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(scene.yfov)),
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(scene.eye, scene.at, [0, 1, 0]),
            "film": film,
            "sampler": {"type": "independent"},
        },
    }
    for index, shape in enumerate(scene.meshes):
        name = f"mesh{index}"
        out |= placed(name, shape) if shape.places else {name: mesh(shape.vertices, shape.triangles, shape.material)}
    if scene.sky:
        out["sky"] = sky()
    return mi.load_dict(out)


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
