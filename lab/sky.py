#!/usr/bin/env python3
"""Compares --sunsky with Mitsuba's `sunsky`: target/peers/mitsuba/bin/python lab/sky.py target/release/bismar

Prints for some elevations and turbidities the irradiance of Mitsuba's sun, and the mean and largest relative difference of the
sky's radiance, at 2 degrees above the horizon and higher.
"""
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
HALF_ANGLE = math.radians(0.5358) / 2
TRIANGLE = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "translation": [0, -50, 0]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"componentType": 5126, "type": "VEC3", "count": 3, "min": [0, 0, 0], "max": [0, 0, 0]}]}


def emitter(elevation, turbidity, **scales):
    """z is up, the sun is above +x."""
    up = math.radians(elevation)
    return mi.load_dict({"type": "sunsky", "sun_direction": [math.cos(up), 0, math.sin(up)], "turbidity": turbidity,
                         "albedo": 0.3, **scales})


def radiance(source, direction):
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = -mi.Vector3f(*direction)
    return np.array(source.eval(interaction)).ravel()


def sun_irradiance(elevation, turbidity, rings=400):
    """Of a surface that faces the sun."""
    sun, up = emitter(elevation, turbidity, sky_scale=0), math.radians(elevation)
    toward, side = np.array([math.cos(up), 0, math.sin(up)]), np.array([0, 1, 0])
    angles = [HALF_ANGLE * math.sqrt((ring + 0.5) / rings) for ring in range(rings)]
    total = sum(radiance(sun, toward * math.cos(angle) + side * math.sin(angle)) for angle in angles)
    return total / rings * math.pi * math.sin(HALF_ANGLE) ** 2


def main(bismar):
    with tempfile.TemporaryDirectory() as folder:
        scene, picture = Path(folder, "scene.gltf"), Path(folder, "sky.exr")
        scene.write_text(json.dumps(TRIANGLE))
        for elevation, turbidity in ((5, 3), (15, 2), (40, 3), (40, 6), (75, 3), (75, 9)):
            subprocess.run([bismar, "-q", "render", scene, "-o", picture, "--sunsky", f"{elevation},90,{turbidity}", "--camera",
                            "panorama", "--size", "512x256", "--spp", "16"], check=True)
            ours, sky = np.array(mi.Bitmap(str(picture)))[..., :3], emitter(elevation, turbidity, sun_scale=0)
            errors = []
            for row in range(2, 125, 4):
                for column in range(0, 512, 8):
                    theta, phi = math.pi * (row + 0.5) / 256, 2 * math.pi * ((column + 0.5) / 512 - 0.5)
                    # Our x is theirs, our y is up.
                    x, y, z = math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi)
                    errors.append(ours[row, column] / radiance(sky, (x, -z, y)) - 1)
            print(f"{elevation:3} degrees, turbidity {turbidity}: sun {sun_irradiance(elevation, turbidity).round(4)}, sky differs by "
                  f"{np.mean(np.abs(errors)):.4f}, at most {np.max(np.abs(errors)):.4f}")


if __name__ == "__main__":
    main(sys.argv[1])
