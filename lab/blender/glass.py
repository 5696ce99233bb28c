"""Scenes with glass, made in Blender, rendered by Cycles and by Bismar from Blender's glTF export.

    glass.py make SCENE FOLDER      writes SCENE.blend and SCENE.glb: open, room, bottle or bulbs
    glass.py cycles SCENE.blend SPP SEED OUT.exr [caustics]
                                    renders with Cycles, one thread; prints its CPU seconds. caustics: shadow caustics,
                                    which Cycles has for lights, not for emissive meshes
    glass.py measure FOLDER SCENE... [--seeds N] [--spp N] [--cycles N]
                                    renders with both, prints the table of lab/peers.md

Run it with a Python that has bpy (5.0.1), NumPy and OpenImageIO (scripts/setup.sh --pictures). The export has its defaults,
and the options for cameras and lights. Bodies of glass have the group node `glTF Material Output` with a thickness, without
which the exporter writes thin walls. Cycles' adaptive sampling, clamping and glossy filter, which change means, are off.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
SIZE = (96, 72)
DEPTH = 32


def material(name, color=(0.7, 0.7, 0.7), roughness=0.8, transmission=0.0, ior=1.45, thickness=0.0, emission=0.0):
    import bpy
    made = bpy.data.materials.new(name)
    made.use_nodes = True  # before Blender 6
    values = made.node_tree.nodes["Principled BSDF"].inputs
    for key, value in {"Base Color": (*color, 1), "Roughness": roughness, "Transmission Weight": transmission, "IOR": ior,
                       "Emission Color": (1, 1, 1, 1), "Emission Strength": emission}.items():
        values[key].default_value = value
    if thickness:
        group = bpy.data.node_groups.get("glTF Material Output")
        if not group:
            group = bpy.data.node_groups.new("glTF Material Output", "ShaderNodeTree")
            group.interface.new_socket("Thickness", in_out="INPUT", socket_type="NodeSocketFloat")
        node = made.node_tree.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        node.inputs["Thickness"].default_value = thickness
    return made


def mesh(name, points, faces, of, smooth=False, at=(0, 0, 0)):
    import bpy
    made = bpy.data.meshes.new(name)
    made.from_pydata(points, [], faces)
    made.materials.append(of)
    made.polygons.foreach_set("use_smooth", [smooth] * len(made.polygons))
    if smooth:
        made.set_sharp_from_angle(angle=math.radians(30))
    thing = bpy.data.objects.new(name, made)
    thing.location = at
    bpy.context.scene.collection.objects.link(thing)


def quad(name, points, of):
    mesh(name, points, [(0, 1, 2, 3)], of)


def lathe(name, profile, of, at=(0, 0, 0), steps=64):
    """A closed body around z; the profile goes from the axis at the bottom to the axis, with the body to its left."""
    points = [(radius * math.cos(turn), radius * math.sin(turn), height) for radius, height in profile
              for turn in (2 * math.pi * i / steps for i in range(steps))]
    faces = []
    for ring in range(len(profile) - 1):
        for i in range(steps):
            a, b = ring * steps + i, ring * steps + (i + 1) % steps
            c, d = b + steps, a + steps
            if profile[ring][0] == 0:
                faces.append((a, c, d))
            elif profile[ring + 1][0] == 0:
                faces.append((a, b, d))
            else:
                faces.append((a, b, c, d))
    mesh(name, points, faces, of, True, at)


def ball(radius, inward=False, rings=32):
    turns = [math.pi * i / rings for i in range(rings + 1)]
    profile = [(0.0 if i in (0, rings) else radius * math.sin(turn), -radius * math.cos(turn)) for i, turn in enumerate(turns)]
    return profile[::-1] if inward else profile


def camera(at, turn, angle):
    import bpy
    data = bpy.data.cameras.new("camera")
    data.angle = math.radians(angle)
    thing = bpy.data.objects.new("camera", data)
    thing.location = at
    thing.rotation_euler = [math.radians(x) for x in turn]
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.scene.camera = thing


def walls(x, y, z, wall, floor, right=True):
    quad("floor", [(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], floor)
    quad("ceiling", [(-x, -y, z), (-x, y, z), (x, y, z), (x, -y, z)], wall)
    quad("back", [(-x, y, 0), (x, y, 0), (x, y, z), (-x, y, z)], wall)
    quad("front", [(x, -y, 0), (-x, -y, 0), (-x, -y, z), (x, -y, z)], wall)
    quad("left", [(-x, -y, 0), (-x, y, 0), (-x, y, z), (-x, -y, z)], wall)
    if right:
        quad("right", [(x, -y, 0), (x, -y, z), (x, y, z), (x, y, 0)], wall)


def room(pane=True):
    """A closed room with a window of 1 m, with or without a thin pane in it, and a sun outside."""
    import bpy
    wall, floor = material("wall"), material("floor", (0.5, 0.35, 0.25))
    x, y, z = 2, 1.5, 2.7
    walls(x, y, z, wall, floor, right=False)
    parts = {"r1": (-y, -0.5, 0, z, wall), "r2": (0.5, y, 0, z, wall), "r3": (-0.5, 0.5, 0, 1, wall), "r4": (-0.5, 0.5, 2, z, wall)}
    if pane:
        parts["pane"] = (-0.5, 0.5, 1, 2, material("glass", (1, 1, 1), 0.0, 1.0))
    for name, (y0, y1, z0, z1, of) in parts.items():
        quad(name, [(x, y0, z0), (x, y0, z1), (x, y1, z1), (x, y1, z0)], of)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 5, 0.009
    thing = bpy.data.objects.new("sun", sun)
    thing.rotation_euler = (0, math.radians(50), 0)
    bpy.context.scene.collection.objects.link(thing)
    camera((-1.8, -1.2, 1.4), (85, 0, -62), 75)


def bottle():
    """A bottle half full and two tumblers, one of them with liquid, on a table under a small lamp."""
    wall, table = material("wall"), material("table", (0.5, 0.35, 0.25))
    walls(0.8, 0.8, 1.2, wall, table)
    glass = material("glass", (1, 1, 1), 0.0, 1.0, 1.5, 0.003)
    liquid = material("liquid", (1, 1, 1), 0.0, 1.0, 1.33, 0.06)
    gap, above = 0.0005, 0.001  # Cycles shows surfaces that coincide in another order
    lathe("bottle", [(0, 0), (0.035, 0), (0.0355, 0.0005), (0.0355, 0.15), (0.030, 0.17), (0.016, 0.19), (0.013, 0.20), (0.013, 0.25),
                     (0.010, 0.25), (0.010, 0.20), (0.013, 0.188), (0.027, 0.168), (0.0325, 0.148), (0.0325, 0.004), (0, 0.004)], glass,
          (0, 0, above))
    lathe("liquid", [(0, 0.004 + gap), (0.0325 - gap, 0.004 + gap), (0.0325 - gap, 0.09), (0, 0.09)], liquid, (0, 0, above))
    tumbler = [(0, 0), (0.032, 0), (0.036, 0.1), (0.0335, 0.1), (0.0297, 0.008), (0, 0.008)]
    lathe("tumbler 1", tumbler, glass, (0.12, -0.03, above))
    lathe("tumbler 2", tumbler, glass, (-0.11, -0.06, above))
    lathe("water", [(0, 0.008 + gap), (0.0297 - gap, 0.008 + gap), (0.0318 - gap, 0.06), (0, 0.06)], liquid, (-0.11, -0.06, above))
    lathe("lamp", ball(0.04, rings=12), material("lamp", emission=60.0), (0.25, 0.25, 0.8), 24)
    camera((0.0, -0.5, 0.3), (66, 0, 0), 50)


def bulbs():
    """A closed room with three bulbs: an emissive ball in a hollow globe of glass."""
    wall, floor = material("wall"), material("floor", (0.5, 0.35, 0.25))
    walls(1.5, 1.5, 2.4, wall, floor)
    glass, lamp = material("glass", (1, 1, 1), 0.0, 1.0, 1.5, 0.003), material("lamp", emission=400.0)
    for i, at in enumerate([(-0.7, 0.4, 1.9), (0.1, 0.6, 1.6), (0.8, 0.2, 1.8)]):
        lathe(f"globe {i}", ball(0.08), glass, at)
        lathe(f"inside {i}", ball(0.077, True), glass, at)
        lathe(f"bulb {i}", ball(0.015, rings=8), lamp, at, 16)
    camera((0, -1.4, 1.3), (92, 0, 0), 75)


SCENES = {"open": lambda: room(False), "room": room, "bottle": bottle, "bulbs": bulbs}


def make(name, folder):
    import bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = SIZE  # the exporter's field of view
    SCENES[name]()
    world = bpy.data.worlds.new("black")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    bpy.context.scene.world = world
    bpy.ops.export_scene.gltf(filepath=f"{folder}/{name}.glb", export_lights=True, export_cameras=True)
    bpy.ops.wm.save_as_mainfile(filepath=f"{folder}/{name}.blend")


def cycles(scene, spp, seed, out, caustics):
    import time
    import bpy
    bpy.ops.wm.open_mainfile(filepath=scene)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    settings = scene.cycles
    settings.device, settings.samples, settings.seed = "CPU", spp, seed
    settings.use_denoising = settings.use_adaptive_sampling = False
    settings.sample_clamp_indirect = settings.sample_clamp_direct = settings.blur_glossy = 0
    for kind in ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces"):
        setattr(settings, kind, DEPTH - 2)
    settings.pixel_filter_type, settings.filter_width = "BOX", 1
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = out
    for thing in scene.objects if caustics else []:
        if thing.type == "LIGHT":
            thing.data.cycles.is_caustics_light = True
        elif thing.type == "MESH":
            glass = thing.active_material.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value > 0
            thing.cycles.is_caustics_caster, thing.cycles.is_caustics_receiver = glass, not glass
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    print("CPU", time.process_time() - start)


def read(path):
    import OpenImageIO
    file = OpenImageIO.ImageInput.open(str(path))
    names = file.spec().channelnames
    return file.read_image("float")[..., [names.index(channel) for channel in "RGB"]].astype(float)


def of_cycles(how, folder, name, spp, seed):
    out = folder / "cycles.exr"
    said = subprocess.run([sys.executable, "-W", "ignore", __file__, "cycles", folder / f"{name}.blend", str(spp), str(seed), out,
                           how], check=True, capture_output=True, text=True).stdout
    return read(out), float(said.split("CPU")[-1].split()[0])


def of_bismar(bismar, folder, name, spp, seed, *flags):
    out = folder / "bismar.exr"
    out.unlink(missing_ok=True)
    before = os.times()
    subprocess.run([bismar, "-q", "render", folder / f"{name}.glb", "--no-env", "--light-unit", "watt", "--size", "{}x{}".format(*SIZE),
                    "--filter", "box", "--max-depth", str(DEPTH), "--spp", str(spp), "--seed", str(seed), "--threads", "1", "--aov",
                    "none", *flags, "-o", out], check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    return read(out), after.children_user + after.children_system - before.children_user - before.children_system


def measure(options):
    """Per scene and way: mean with its standard error, relMSE of one render, CPU seconds, product.

    The reference is the mean of the scene's first way: `--glass-shadows off`, or the plain command for the room. relMSE is the mean of variance / (reference^2 +
    0.01) over pixels and channels, with the sample variance of a way's own renders of different seeds: noise alone. *Against*
    compares the means of the pictures.
    """
    import numpy
    options.folder.mkdir(parents=True, exist_ok=True)
    print("| scene | way | mean | against the reference | relMSE | CPU seconds | relMSE x seconds |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name in options.scenes:
        subprocess.run([sys.executable, "-W", "ignore", __file__, "make", name, options.folder], check=True,
                       stdout=subprocess.DEVNULL)
        ways = {f"Bismar, `--glass-shadows {how}`": (of_bismar, options.bismar, options.spp, ["--glass-shadows", how])
                for how in ("off", "straight")}
        if name in ("open", "room"):  # a thin pane is no body
            ways = {"Bismar": (of_bismar, options.bismar, options.spp, [])}
        ways["Cycles"] = (of_cycles, "plain", options.cycles, [])
        if name == "room":
            ways["Cycles, shadow caustics"] = (of_cycles, "caustics", options.cycles, [])
        reference = None
        for way, (render, how, spp, flags) in ways.items():
            made = [render(how, options.folder, name, spp, seed, *flags) for seed in range(1, options.seeds + 1)]
            pictures, seconds = numpy.array([picture for picture, _ in made]), numpy.mean([seconds for _, seconds in made])
            means, mean = pictures.mean(axis=(1, 2, 3)), pictures.mean(axis=0)
            reference = mean if reference is None else reference
            error, shift = means.std(ddof=1) / math.sqrt(len(means)), 100 * (mean.mean() / reference.mean() - 1)
            rel = (pictures.var(axis=0, ddof=1) / (reference ** 2 + 0.01)).mean()
            print(f"| {name} | {way} | {mean.mean():.4f} ± {error:.4f} | {shift:+.1f} % | {rel:.3g} | {seconds:.1f} | "
                  f"{rel * seconds:.3g} |", flush=True)
            numpy.save(options.folder / f"{name}-{list(ways).index(way)}.npy", pictures)


def main():
    if sys.argv[1:2] == ["make"]:
        return make(*sys.argv[2:4])
    if sys.argv[1:2] == ["cycles"]:
        scene, spp, seed, out = sys.argv[2:6]
        return cycles(scene, int(spp), int(seed), out, sys.argv[6:] == ["caustics"])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=["measure"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="+", choices=list(SCENES))
    parser.add_argument("--seeds", type=int, default=8, metavar="N")
    parser.add_argument("--spp", type=int, default=256, metavar="N", help="Bismar's paths per pixel")
    parser.add_argument("--cycles", type=int, default=512, metavar="N", help="Cycles' paths per pixel")
    parser.add_argument("--bismar", type=Path, default=ROOT / "target/release/bismar", metavar="PROGRAM")
    return measure(parser.parse_args())


if __name__ == "__main__":
    main()
