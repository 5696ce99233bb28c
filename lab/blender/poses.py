"""Holds animated vertices to Blender's importer: poses.py BISMAR_EXAMPLE SCENE[@ANIMATION]... > table.md

Run it with a Python that has bpy (PyPI, 5.0.1) and numpy. BISMAR_EXAMPLE is `target/release/examples/vertices`. For each
scene and three moments, one of them a key: the largest distance from a corner of ours to the nearest of Blender's, and
back, over the size of the whole. Between keys Blender joins the four numbers of a rotation by lines, where the
specification takes the shortest way on the sphere.
"""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import kdtree


def ours(program, scene, animation, seconds):
    line = [program, scene, str(seconds), *([animation] if animation else [])]
    text = subprocess.run(line, check=True, capture_output=True, text=True).stdout
    return np.array(text.split(), float).reshape(-1, 3)


def load(scene, animation):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(scene), guess_original_bind_pose=False, import_shading="NORMALS")
    for thing in [*bpy.data.objects, *bpy.data.shape_keys]:
        if not (data := thing.animation_data):
            continue
        for track in data.nla_tracks:
            track.mute = True
            # A track's strip begins at frame 1; the action itself has the file's times.
            if animation == track.name:
                data.action, data.action_slot = track.strips[0].action, track.strips[0].action_slot


def corners(seconds):
    frame = seconds * bpy.context.scene.render.fps
    bpy.context.scene.frame_set(int(frame), subframe=frame - int(frame))
    graph = bpy.context.evaluated_depsgraph_get()
    out = []
    for instance in graph.object_instances:
        thing = instance.object
        # The importer's own shapes of bones are not of the file.
        if thing.type != "MESH" or thing.name.startswith("Icosphere"):
            continue
        mesh = thing.to_mesh()
        mesh.calc_loop_triangles()
        points = np.array([vertex.co for vertex in mesh.vertices])
        used = np.array([t.vertices for t in mesh.loop_triangles]).ravel()
        world = np.array(instance.matrix_world)
        out.append(points[used] @ world[:3, :3].T + world[:3, 3])
        thing.to_mesh_clear()
    x, y, z = np.concatenate(out).T
    return np.stack([x, z, -y], 1)  # to glTF's axes


def curves(action):
    for layer in action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                yield from bag.fcurves


def farthest(points, among):
    tree = kdtree.KDTree(len(among))
    for index, point in enumerate(among):
        tree.insert(point, index)
    tree.balance()
    return max(tree.find(point)[2] for point in np.unique(points, axis=0))


def main():
    program, *scenes = sys.argv[1:]
    print("| scene | at s | corners | size | largest distance over size |")
    print("| --- | --- | --- | --- | --- |")
    for scene in scenes:
        scene, _, animation = scene.partition("@")
        scene = Path(scene)
        load(scene, animation)
        actions = [action for action in bpy.data.actions if action.name.startswith(animation)]
        keys = sorted({key.co[0] for action in actions for curve in curves(action) for key in curve.keyframe_points})
        for frame in (keys[0], keys[len(keys) // 2], (keys[-1] + 3 * keys[-2]) / 4):
            seconds = frame / bpy.context.scene.render.fps
            a, b = ours(program, scene, animation, seconds), corners(seconds)
            size = np.ptp(b, axis=0).max()
            distance = max(farthest(a, b), farthest(b, a)) / size
            print(f"| {scene.stem} {animation} | {seconds:.4g} | {len(a)} | {size:.3g} | {distance:.1e} |", flush=True)


main()
