"""Pictures an hour of a data set: objects x cameras with beauty, depth, normals and ids, by Bismar, Mitsuba 3 and Cycles.

data_set.py PYTHON[,PYTHON…] runs it: each interpreter has one of the packages bismar, mitsuba and bpy, and takes its turn.
All render the same meshes, materials, light and cameras to float arrays, at equal paths a pixel. Set-up counts: a data set
loads each object once. Bismar is without adaptive sampling, so that every pixel takes the same
number of paths. Mitsuba needs DRJIT_LIBLLVM_PATH where bench-peers/setup.sh says so.
"""

import argparse

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from glb import Glb

YFOV = 0.7
DISTANCE = 4.0
PARTS = 3
AOVS = ["depth", "normal", "object"]


def parts(number):
    """Three blobs on top of each other: (vertices, triangles, colour) each. Numbers follow from the object's alone."""
    random = np.random.default_rng(number)
    rings, columns = 48, 96
    theta = np.pi * np.arange(rings + 1)[:, None] / rings
    phi = 2 * np.pi * np.arange(columns)[None, :] / columns
    ring, column = np.meshgrid(np.arange(rings), np.arange(columns), indexing="ij")
    at = lambda r, c: r * columns + c % columns
    a, b, c, d = at(ring, column), at(ring + 1, column), at(ring + 1, column + 1), at(ring, column + 1)
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    for part in range(PARTS):
        waves = random.integers(1, 6, 2)
        radius = 0.35 * (1 + 0.2 * np.sin(waves[0] * phi + random.uniform(0, 6)) * np.sin(waves[1] * theta))
        across = np.sin(theta) * radius
        points = np.stack([across * np.sin(phi), np.cos(theta) * radius, across * np.cos(phi)], -1).reshape(-1, 3)
        yield (points + [0, 0.6 * (part - 1), 0]).astype(np.float32), triangles.astype(np.uint32), random.uniform(0.1, 0.8, 3)


def eyes(number, count):
    """Azimuth and elevation in degrees of an object's cameras, which look at the origin."""
    random = np.random.default_rng(1000 + number)
    return np.stack([random.uniform(0, 360, count), random.uniform(-20, 60, count)], -1)


def matrix(azimuth, elevation):
    """Camera to world; the camera looks along -z with +y up."""
    a, e = math.radians(azimuth), math.radians(elevation)
    z = np.array([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)])
    x = np.array([math.cos(a), 0, -math.sin(a)])
    out = np.eye(4)
    out[:3] = np.stack([x, np.cross(z, x), z, DISTANCE * z], -1)
    return out


def glb(number):
    scene = Glb(extensionsUsed=["KHR_materials_specular"])
    for part, (points, triangles, color) in enumerate(parts(number)):
        pbr = {"baseColorFactor": [*color, 1], "metallicFactor": 0, "roughnessFactor": 1}
        matt = {"KHR_materials_specular": {"specularFactor": 0}}
        material = scene.add("materials", pbrMetallicRoughness=pbr, extensions=matt)
        scene.node(mesh=scene.mesh(points, triangles, material), name=f"part {part}")
    return scene.file()


def by_bismar(opt, number, path):
    import bismar

    scene = bismar.load(path, sky=True)
    for index, eye in enumerate(eyes(number, opt.cameras)):
        camera = scene.add_camera(matrix(*eye), math.degrees(YFOV), f"view {index}")
        picture = scene.render(camera, (opt.size, opt.size), spp=opt.spp, max_depth=opt.depth, adaptive="off", aovs=AOVS)
        yield [picture["beauty"][..., :3], picture["depth"][..., 0], picture["normal"], picture["object"][..., 0]]


def by_mitsuba(opt, number, path):
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("llvm_ad_rgb")
    from mitsuba_scene import mesh, rgb

    path_integrator = {"type": "path", "max_depth": opt.depth, "rr_depth": 1000}
    scene = {
        "type": "scene",
        "integrator": {"type": "aov", "aovs": "depth:depth,normal:sh_normal,id:shape_index", "image": path_integrator},
        "sky": {"type": "constant", "radiance": 1.0},
    }
    for part, (points, triangles, color) in enumerate(parts(number)):
        scene[f"part{part}"] = mesh(points, triangles, {"type": "diffuse", "reflectance": rgb(color)})
    scene = mi.load_dict(scene)
    film = {"type": "hdrfilm", "width": opt.size, "height": opt.size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    turned = np.diag([-1.0, 1, -1, 1])  # Mitsuba's cameras look along +z
    for eye in eyes(number, opt.cameras):
        sensor = mi.load_dict({"type": "perspective", "fov": math.degrees(YFOV), "fov_axis": "y", "film": film,
                               "to_world": mi.ScalarTransform4f(matrix(*eye) @ turned)})
        image = np.array(mi.render(scene, sensor=sensor, spp=opt.spp))
        yield [image[..., :3], image[..., 3], image[..., 4:7], image[..., 7]]


def by_cycles(opt, number, path):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path), import_shading="FLAT")
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (1, 1, 1, 1)
    for index, one in enumerate(scene.objects):
        one.pass_index = index + 1
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_fit, camera.data.angle = "VERTICAL", YFOV
    scene.collection.objects.link(camera)
    scene.camera, render, cycles, layer = camera, scene.render, scene.cycles, scene.view_layers[0]
    render.engine, render.resolution_x, render.resolution_y, render.resolution_percentage = "CYCLES", opt.size, opt.size, 100
    render.use_persistent_data = True
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", opt.spp, False, False
    cycles.max_bounces = cycles.diffuse_bounces = opt.depth - 2
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    layer.use_pass_z = layer.use_pass_normal = layer.use_pass_object_index = True
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    render.filepath = f"{path}.exr"
    from mathutils import Matrix

    to_blender = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
    for eye in eyes(number, opt.cameras):
        camera.matrix_world = to_blender @ Matrix(matrix(*eye).tolist())
        # Blender gives no array of a render without a window: through a file, which its users do too.
        bpy.ops.render.render(write_still=True)
        yield [np.fromfile(f"{path}.exr", np.uint8)]


RENDERERS = {"bismar": by_bismar, "mitsuba": by_mitsuba, "bpy": by_cycles}


def options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pythons", help="interpreters, separated by commas")
    for name, value in (("objects", 40), ("cameras", 24), ("size", 256), ("spp", 32), ("depth", 8)):
        parser.add_argument(f"--{name}", type=int, default=value, help="[%(default)s]")
    parser.add_argument("--turn", choices=RENDERERS, help=argparse.SUPPRESS)
    return parser.parse_args()


def turn(opt):
    """What one renderer needs for the whole set, as a line of JSON on the last line of standard output."""
    import importlib

    importlib.import_module(opt.turn)
    start, means, count = time.perf_counter(), [], 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(opt.objects):
            path = Path(folder) / f"{number}.glb"
            path.write_bytes(glb(number))
            for arrays in RENDERERS[opt.turn](opt, number, path):
                count += 1
                means.append(float(np.mean(arrays[0], dtype=np.float64)))
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds, cpu = time.perf_counter() - start, used.ru_utime + used.ru_stime
    print("\n" + json.dumps({"pictures": count, "seconds": seconds, "cpu": cpu, "peak_mib": used.ru_maxrss // 1024, "mean": np.mean(means)}), flush=True)
    os._exit(0)  # Mitsuba's threads do not always end


def main():
    opt = options()
    if opt.turn:
        return turn(opt)
    has = "import importlib.util, sys; sys.exit(importlib.util.find_spec(sys.argv[1]) is None)"
    print(f"{opt.objects} objects x {opt.cameras} cameras, {opt.size} x {opt.size}, {opt.spp} paths a pixel, {os.cpu_count()} threads")
    print(f"{'renderer':10}{'pictures an hour':>18}{'a CPU hour':>12}{'peak MiB':>10}{'mean':>8}")
    for python in opt.pythons.split(","):
        for name in RENDERERS:
            if subprocess.run([python, "-c", has, name]).returncode:
                continue
            flags = [f"--{key}={getattr(opt, key)}" for key in ("objects", "cameras", "size", "spp", "depth")]
            run = subprocess.run([python, __file__, "-", "--turn", name, *flags], stdout=subprocess.PIPE, check=True)
            found = json.loads(run.stdout.decode().strip().splitlines()[-1])
            per_hour = [3600 * found["pictures"] / found[key] for key in ("seconds", "cpu")]
            mean = f"{found['mean']:8.4f}" if name != "bpy" else ""
            print(f"{name:10}{per_hour[0]:18.0f}{per_hour[1]:12.0f}{found['peak_mib']:10}{mean}", flush=True)


if __name__ == "__main__":
    main()
