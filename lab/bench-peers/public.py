"""A glTF file as a Mitsuba scene, as far as the converted scenes of others need it: one world, no textures but of base colours."""

import json
import struct
import tempfile
from pathlib import Path

import numpy as np

import mitsuba as mi

TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


def load(path, size):
    """The scene without an integrator: `size` pixels of each side, Mitsuba's `principled` BSDF, lamps that shine from their front."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    gltf, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def view(index):
        found = gltf["bufferViews"][index]
        start = found.get("byteOffset", 0)
        return binary[start : start + found["byteLength"]]

    def array(index):
        found = gltf["accessors"][index]
        count = found["count"] * SIZES[found["type"]]
        values = np.frombuffer(view(found["bufferView"]), TYPES[found["componentType"]], count, found.get("byteOffset", 0))
        return values.reshape(found["count"], -1)

    def color(surface):
        if "baseColorTexture" not in surface:
            return {"type": "rgb", "value": surface["baseColorFactor"][:3]}
        image = gltf["images"][gltf["textures"][surface["baseColorTexture"]["index"]]["source"]]
        with tempfile.NamedTemporaryFile(suffix=".jpg") as file:
            file.write(view(image["bufferView"]))
            file.flush()
            return {"type": "bitmap", "bitmap": mi.Bitmap(file.name)}

    def mesh(primitive, to_world):
        material, attributes = gltf["materials"][primitive["material"]], primitive["attributes"]
        surface, extensions = material["pbrMetallicRoughness"], material.get("extensions", {})
        ior = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
        glass = extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0)
        bsdf = {"type": "principled", "base_color": color(surface), "roughness": surface["roughnessFactor"],
                "metallic": surface["metallicFactor"], "spec_trans": glass}  # fmt: skip
        if "KHR_materials_specular" in extensions:
            bsdf = {"type": "diffuse", "reflectance": bsdf["base_color"]}
        else:
            bsdf["eta"] = ior
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(bsdf if glass else {"type": "twosided", "nested": bsdf})
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        emission = np.multiply(material.get("emissiveFactor", [0.0] * 3), strength)
        if emission.any():
            properties["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": emission.tolist()}})
        points, triangles = array(attributes["POSITION"]) @ to_world[:3, :3].T + to_world[:3, 3], array(primitive["indices"])
        normals, uv = attributes.get("NORMAL"), attributes.get("TEXCOORD_0")
        out = mi.Mesh("mesh", len(points), len(triangles) // 3, properties, normals is not None, uv is not None)
        values = mi.traverse(out)
        values["vertex_positions"], values["faces"] = np.float32(points).ravel(), np.uint32(triangles).ravel()
        if normals is not None:
            values["vertex_normals"] = np.float32(array(normals) @ np.linalg.inv(to_world[:3, :3])).ravel()
        if uv is not None:
            values["vertex_texcoords"] = np.float32(array(uv) * [1, -1] + [0, 1]).ravel()
        values.update()
        return out

    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    out = {"type": "scene"}
    for index, node in enumerate(gltf["nodes"]):
        to_world = np.reshape(node.get("matrix", np.eye(4).ravel()), (4, 4)).T
        if "camera" in node:
            fov = float(np.degrees(gltf["cameras"][node["camera"]]["perspective"]["yfov"]))
            # Mitsuba's camera looks along +z, glTF's along -z.
            to_world = mi.ScalarTransform4f(to_world @ np.diag([-1.0, 1.0, -1.0, 1.0]))
            sensor = {"type": "perspective", "fov": fov, "fov_axis": "y", "to_world": to_world, "film": film}
            out["sensor"] = sensor | {"sampler": {"type": "independent"}}
        elif "mesh" in node:
            for k, primitive in enumerate(gltf["meshes"][node["mesh"]]["primitives"]):
                out[f"mesh{index}_{k}"] = mesh(primitive, to_world)
    sky = path.with_suffix(".hdr")
    return out | ({"sky": {"type": "envmap", "filename": str(sky)}} if sky.exists() else {})
