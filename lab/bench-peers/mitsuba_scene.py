"""Meshes for Mitsuba, and glTF files as far as the converted scenes of others need it: no textures but of base colours."""

import json
import struct
import tempfile
from pathlib import Path

import numpy as np

import mitsuba as mi

TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


def rgb(value):
    return {"type": "rgb", "value": [float(x) for x in value]}


def mesh(points, triangles, bsdf, emission=None, normals=None, uv=None):
    """A mesh from arrays of vertex data and of triangles; it is flat without normals, and shines from its front with an emission."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    properties["face_normals"] = normals is None
    if emission is not None:
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(emission)})
    arguments = {"has_vertex_normals": normals is not None, "has_vertex_texcoords": uv is not None}
    out = mi.Mesh("mesh", len(points), len(triangles), props=properties, **arguments)
    values = mi.traverse(out)
    values["faces"] = np.ascontiguousarray(triangles, np.uint32).ravel()
    for name, data in (("vertex_positions", points), ("vertex_normals", normals), ("vertex_texcoords", uv)):
        if data is not None:
            values[name] = np.ascontiguousarray(data, np.float32).ravel()
    values.update()
    return out


def load(path):
    """The file's vertical field of view in radians, the matrix of its camera, which looks along -z, and its meshes and sky by names:
    Mitsuba's `principled` BSDF, lamps that shine from their front."""
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
            return rgb(surface["baseColorFactor"][:3])
        image = gltf["images"][gltf["textures"][surface["baseColorTexture"]["index"]]["source"]]
        with tempfile.NamedTemporaryFile(suffix=".jpg") as file:
            file.write(view(image["bufferView"]))
            file.flush()
            return {"type": "bitmap", "bitmap": mi.Bitmap(file.name)}

    def shape(primitive, to_world):
        material, attributes = gltf["materials"][primitive["material"]], primitive["attributes"]
        surface, extensions = material["pbrMetallicRoughness"], material.get("extensions", {})
        glass = extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0)
        if "KHR_materials_specular" in extensions:
            bsdf = {"type": "diffuse", "reflectance": color(surface)}
        else:
            bsdf = {"type": "principled", "base_color": color(surface), "roughness": surface["roughnessFactor"],
                    "metallic": surface["metallicFactor"], "spec_trans": glass,
                    "eta": extensions.get("KHR_materials_ior", {}).get("ior", 1.5)}  # fmt: skip
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        emission = np.multiply(material.get("emissiveFactor", [0.0] * 3), strength)
        points, triangles = array(attributes["POSITION"]) @ to_world[:3, :3].T + to_world[:3, 3], array(primitive["indices"])
        normals, uv = attributes.get("NORMAL"), attributes.get("TEXCOORD_0")
        return mesh(
            points,
            triangles.reshape(-1, 3),
            bsdf if glass else {"type": "twosided", "nested": bsdf},
            emission if emission.any() else None,
            None if normals is None else array(normals) @ np.linalg.inv(to_world[:3, :3]),
            None if uv is None else array(uv) * [1, -1] + [0, 1],
        )

    out = {}
    for index, node in enumerate(gltf["nodes"]):
        to_world = np.reshape(node.get("matrix", np.eye(4).ravel()), (4, 4)).T
        if "camera" in node:
            yfov, camera = gltf["cameras"][node["camera"]]["perspective"]["yfov"], to_world
        elif "mesh" in node:
            for k, primitive in enumerate(gltf["meshes"][node["mesh"]]["primitives"]):
                out[f"mesh{index}_{k}"] = shape(primitive, to_world)
    if path.with_suffix(".hdr").exists():
        out["sky"] = {"type": "envmap", "filename": str(path.with_suffix(".hdr"))}
    return yfov, camera, out
