"""Blender Cycles as a peer, through Blender's own glTF importer. `cycles_peer.py '{"folder": DIR, "scene": NAME, "size": N, "depth": N, "denoise": false}'`

Prints {"setup": seconds}, then for each line `SPP SEED FILE.npy` on standard input renders and prints what that took.
"""

import json
import os
import resource
import sys
import time

START = time.perf_counter()
# Blender talks on standard output: the answers get it to themselves.
ANSWERS = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import bpy
import numpy as np
import scenes

ARGS = json.loads(sys.argv[1])
GUIDED = ("slit", "ajar")


def answer(**values):
    print(json.dumps(values), file=ANSWERS, flush=True)


def shade(material):
    """The BSDFs of the others: pure diffuse, pure GGX, or a lamp that shines from its front alone."""
    tree = material.node_tree
    principled = [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]
    if not principled:
        return
    principled = principled[0]
    socket = principled.inputs
    color, strength = socket["Emission Color"].default_value[:3], socket["Emission Strength"].default_value
    if max(color) * strength > 0:
        shader = tree.nodes.new("ShaderNodeEmission")
        shader.inputs["Color"].default_value = (*color, 1)
        back = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
        front = math(tree, "SUBTRACT", 1.0, back)
        tree.links.new(math(tree, "MULTIPLY", strength, front), shader.inputs["Strength"])
    elif ARGS["scene"] not in scenes.SCENES or socket["Metallic"].default_value > 0.5:
        shader = principled
        shader.distribution = "GGX"
    else:
        shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
        shader.inputs["Color"].default_value = socket["Base Color"].default_value[:]
    output = [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL"][0]
    tree.links.new(shader.outputs[0], output.inputs["Surface"])


def math(tree, operation, number, link):
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    node.inputs[0].default_value = number
    tree.links.new(link, node.inputs[1])
    return node.outputs[0]


def light_from_sky(scene, sky):
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    background = tree.nodes["Background"]
    background.inputs[0].default_value = (0, 0, 0, 1)
    if os.path.exists(sky):
        node = tree.nodes.new("ShaderNodeTexEnvironment")
        node.image = bpy.data.images.load(sky)
        node.image.colorspace_settings.name = "Linear Rec.709"
        tree.links.new(node.outputs["Color"], background.inputs[0])


def load():
    name, folder = ARGS["scene"], ARGS["folder"]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=f"{folder}/{name}.glb", import_shading="FLAT")
    scene = bpy.context.scene
    scene.camera = next(o for o in scene.objects if o.type == "CAMERA")
    for material in bpy.data.materials:
        shade(material)
    light_from_sky(scene, f"{folder}/{name}.hdr")
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = ARGS["size"]
    render.resolution_percentage = 100
    render.use_persistent_data = True
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = False
    cycles.use_denoising, cycles.denoiser = ARGS["denoise"], "OPENIMAGEDENOISE"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0
    # Its bounces leave out the segments from the camera and to the light.
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = ARGS["depth"] - 2
    cycles.caustics_reflective = True
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.use_light_tree = True
    # Learns as long as it renders.
    cycles.use_guiding, cycles.guiding_training_samples = name in GUIDED, 0
    scene.view_settings.view_transform = "Raw"
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    return scene


def take(scene, spp, seed, path):
    size = ARGS["size"]
    scene.cycles.samples, scene.cycles.seed = spp, seed
    scene.render.filepath = f"{path}.exr"
    start, cpu = time.perf_counter(), time.process_time()
    bpy.ops.render.render(write_still=True)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    image = bpy.data.images.load(f"{path}.exr")
    pixels = np.array(image.pixels[:], np.float32).reshape(size, size, 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    os.remove(f"{path}.exr")
    np.save(path, pixels)
    return seconds, cpu


scene = load()
take(scene, 1, 0, "/dev/shm/bench-peers-warm.npy")
answer(setup=time.perf_counter() - START, version=bpy.app.version_string)
# Blender's own work around a render, the same for any spp: not charged to Cycles.
fixed, fixed_cpu = np.min([take(scene, 1, seed, "/dev/shm/bench-peers-warm.npy") for seed in range(3)], axis=0)
for line in sys.stdin:
    spp, seed, path = line.split()
    seconds, cpu = take(scene, int(spp), int(seed), path)
    share = int(spp) / max(int(spp) - 1, 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    answer(seconds=(seconds - fixed) * share, cpu=(cpu - fixed_cpu) * share, peak_mib=peak)
