"""What OpenImageIO and Blender make of OpenEXR files: look.py FILE.exr..., JSON on stdout.

Of each file: `channels` and `parts` as OpenImageIO reads them, `said` (anything at all that oiiotool has to say on stderr),
`blender`: null without bpy, else how the process ended and the largest difference between what its compositor shows of the
picture and what OpenImageIO has read.
"""

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy
import OpenImageIO as oiio

COMPOSITE = """
import bpy, sys
source, out, width, height = sys.argv[1:]
scene = bpy.context.scene
for thing in list(bpy.data.objects):
    bpy.data.objects.remove(thing)
tree = scene.compositing_node_group = bpy.data.node_groups.new("look", "CompositorNodeTree")
tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
node = tree.nodes.new("CompositorNodeImage")
node.image = bpy.data.images.load(source)
node.image.colorspace_settings.name = "Linear Rec.709"
combined = next(s for s in node.outputs if s.enabled and s.name in ("Combined", "Image"))
tree.links.new(combined, tree.nodes.new("NodeGroupOutput").inputs[0])
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = int(width), int(height), 100
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = out
bpy.ops.render.render(write_still=True)
"""


def beauty(path):
    """R, G, B, A over the data window, and the window's place in the display window."""
    file = oiio.ImageInput.open(str(path))
    spec = file.spec()
    pixels = file.read_image(0, 0, 0, spec.nchannels, "float").reshape(spec.height, spec.width, -1)
    names = list(spec.channelnames)
    return spec, pixels[..., [names.index(c) for c in "RGBA"]]


def blender(path, scratch):
    if importlib.util.find_spec("bpy") is None:
        return None
    spec, ours = beauty(path)
    out = scratch / "composite.exr"
    out.unlink(missing_ok=True)
    line = [sys.executable, "-c", COMPOSITE, str(path), str(out), str(spec.full_width), str(spec.full_height)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300)
    found = {"ended": done.returncode}
    if done.returncode == 0 and (spec.full_width, spec.full_height) == (spec.width, spec.height):
        found["difference"] = float(numpy.abs(beauty(out)[1] - ours).max())
    return found


def look(path, scratch):
    tool = Path(sys.executable).parent / "oiiotool"
    said = subprocess.run([tool, "--info", "-v", "-a", "--hash", path], capture_output=True, text=True)
    file = oiio.ImageInput.open(str(path))
    if file is None:
        return {"said": oiio.geterror()}
    parts = 1
    while file.seek_subimage(parts, 0):
        parts += 1
    oiio.geterror()
    file.seek_subimage(0, 0)
    spec = file.spec()
    file.read_image(0, 0, 0, spec.nchannels, "float")
    return {
        "said": said.stderr + file.geterror() + ("" if said.returncode == 0 else f"exit code {said.returncode}"),
        "parts": parts,
        "channels": {n: str(t) for n, t in zip(spec.channelnames, spec.channelformats or [spec.format] * spec.nchannels)},
        "blender": blender(path, scratch),
    }


with tempfile.TemporaryDirectory() as scratch:
    print(json.dumps({path: look(path, Path(scratch)) for path in sys.argv[1:]}))
