"""The scenes that Bismar and its peers render side by side. `python scenes.py DIR [NAME...]` writes DIR/NAME.glb, and its sky as DIR/NAME.hdr.

Every material is pure Lambert (KHR_materials_specular at 0) or pure metal (GGX, alpha = roughness squared, Schlick's
Fresnel with F0 = base colour), triangles are flat and lamps shine from their front alone, so that every renderer can be
given the same light transport.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from glb import Glb


@dataclass
class Material:
    color: tuple
    metallic: bool = False
    roughness: float = 1.0
    emission: tuple | None = None

    def gltf(self):
        out = {
            "doubleSided": self.emission is None,
            "pbrMetallicRoughness": {
                "baseColorFactor": [*map(float, self.color), 1.0],
                "metallicFactor": float(self.metallic),
                "roughnessFactor": float(self.roughness),
            },
        }
        if not self.metallic:
            out["extensions"] = {"KHR_materials_specular": {"specularFactor": 0.0}}
        if self.emission is not None:
            strength = max(self.emission)
            out["emissiveFactor"] = [float(e / strength) for e in self.emission]
            out["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": float(strength)}
        return out


@dataclass
class Place:
    """Scale, then a turn about +y by `angle` radians, then a move."""

    move: tuple = (0.0, 0.0, 0.0)
    angle: float = 0.0
    scale: float = 1.0

    def apply(self, vertices):
        return turn(vertices * self.scale, self.angle) + np.asarray(self.move)


@dataclass
class Mesh:
    vertices: np.ndarray
    triangles: np.ndarray
    material: Material
    places: list = field(default_factory=list)  # none: once, as it is


@dataclass
class Scene:
    meshes: list
    eye: tuple
    at: tuple
    yfov: float
    sky: bool = False

    def write(self, path):
        """As binary glTF."""
        glb = Glb(extensionsUsed=["KHR_materials_emissive_strength", "KHR_materials_specular"])
        for mesh in self.meshes:
            index = glb.mesh(mesh.vertices, mesh.triangles, glb.add("materials", **mesh.material.gltf()))
            if not mesh.places:
                glb.node(mesh=index)
            for place in mesh.places:
                half = place.angle / 2
                rotation = [0.0, float(np.sin(half)), 0.0, float(np.cos(half))]
                translation = [float(x) for x in place.move]
                glb.node(mesh=index, translation=translation, rotation=rotation, scale=[float(place.scale)] * 3)
        camera = glb.add("cameras", type="perspective", perspective={"yfov": self.yfov, "znear": 0.01, "aspectRatio": 1.0})
        glb.node(name="camera", camera=camera, matrix=self.camera().T.ravel().tolist())
        path.write_bytes(glb.file())

    def camera(self):
        """Camera to world."""
        z = np.subtract(self.eye, self.at) / np.linalg.norm(np.subtract(self.eye, self.at))
        x = np.cross([0, 1, 0], z)
        x /= np.linalg.norm(x)
        matrix = np.eye(4)
        matrix[:3] = np.stack([x, np.cross(z, x), z, np.asarray(self.eye)], axis=1)
        return matrix


def turn(vertices, angle):
    c, s = np.cos(angle), np.sin(angle)
    return vertices @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T


def quad(a, b, c, d):
    return np.array([a, b, c, d], float), np.array([[0, 1, 2], [0, 2, 3]])


def box(center, size, angle=0.0):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(size) / 2
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    vertices = np.concatenate([turn(corners, angle)[list(side)] + center for side in sides])
    return vertices, np.concatenate([[[k, k + 1, k + 2], [k, k + 2, k + 3]] for k in range(0, 24, 4)])


def sphere(rings, radius=1.0, center=(0, 0, 0), bumps=lambda theta, phi: 1.0):
    theta, phi = np.meshgrid(np.arange(rings + 1) / rings * np.pi, np.arange(2 * rings + 1) / rings * np.pi, indexing="ij")
    unit = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    vertices = unit * np.asarray(radius * bumps(theta, phi) * np.ones_like(theta))[..., None]
    wide = 2 * rings + 1
    a = (np.arange(rings)[:, None] * wide + np.arange(2 * rings)).ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + wide], -1), np.stack([a + 1, a + wide + 1, a + wide], -1)])
    return vertices.reshape(-1, 3) + center, triangles


def cornell():
    white, red, green = Material((0.73,) * 3), Material((0.65, 0.05, 0.05)), Material((0.12, 0.45, 0.15))
    lamp = Material((0, 0, 0), emission=(17, 12, 4))
    parts = [
        (quad((-1, -1, 1), (1, -1, 1), (1, -1, -1), (-1, -1, -1)), white),
        (quad((-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)), white),
        (quad((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)), white),
        (quad((-1, -1, 1), (-1, -1, -1), (-1, 1, -1), (-1, 1, 1)), red),
        (quad((1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1)), green),
        (quad((-0.25, 0.995, -0.25), (0.25, 0.995, -0.25), (0.25, 0.995, 0.25), (-0.25, 0.995, 0.25)), lamp),
        (box((-0.35, -0.4, -0.3), (0.6, 1.2, 0.6), 0.3), white),
        (box((0.35, -0.7, 0.35), (0.6, 0.6, 0.6), -0.3), white),
    ]
    return Scene([Mesh(*shape, material) for shape, material in parts], (0, 0, 3.9), (0, 0, 0), 0.6911)


def veach():
    """Plates of four roughnesses under lamps of four sizes: where light and BSDF sampling need each other."""
    meshes = []
    for alpha, y, z, tilt in ((0.07, -0.9, 1.2, 0.25), (0.14, -0.75, 0.6, 0.4), (0.26, -0.45, 0.0, 0.6), (0.4, 0.0, -0.5, 0.85)):
        c, s = np.cos(tilt) * 0.28, np.sin(tilt) * 0.28
        vertices, triangles = quad((-2, -s, c), (2, -s, c), (2, s, -c), (-2, s, -c))
        meshes.append(Mesh(vertices + [0, y, z], triangles, Material((0.8,) * 3, True, alpha**0.5)))
    for x, radius in ((-1.5, 0.033), (-0.5, 0.1), (0.5, 0.3), (1.5, 0.5)):
        lamp = Material((0, 0, 0), emission=(2 / radius**2,) * 3)
        meshes.append(Mesh(*sphere(16, radius, (x, 1.6, -1.2)), lamp))
    grey = Material((0.4,) * 3)
    meshes.append(Mesh(*quad((-6, -1.5, 6), (6, -1.5, 6), (6, -1.5, -4), (-6, -1.5, -4)), grey))
    meshes.append(Mesh(*quad((-6, -1.5, -4), (6, -1.5, -4), (6, 6, -4), (-6, 6, -4)), grey))
    return Scene(meshes, (0, 1.2, 6), (0, 0.2, 0), 0.6)


def blob():
    """A bumpy metal ball of 490 k triangles under a sky with a small sun."""

    def bumps(theta, phi):
        return 1 + 0.15 * np.sin(9 * phi) * np.sin(7 * theta) + 0.03 * np.sin(53 * phi) * np.cos(47 * theta)

    ground = quad((-6, -1.2, 6), (6, -1.2, 6), (6, -1.2, -6), (-6, -1.2, -6))
    gold = Material((0.9, 0.7, 0.4), True, 0.387)
    meshes = [Mesh(*sphere(350, bumps=bumps), gold), Mesh(*ground, Material((0.6,) * 3))]
    return Scene(meshes, (0, 1, 4), (0, 0.2, 0), 0.927, sky=True)


def lamps():
    """A room with pillars and 200 small lamps of very different power: which one to sample?"""
    random = np.random.default_rng(1)
    plaster, floor, wood = Material((0.75,) * 3), Material((0.35, 0.3, 0.25)), Material((0.5, 0.3, 0.15))
    x, y, z = 5.0, 3.0, 7.0
    meshes = [
        Mesh(*quad((-x, 0, z), (x, 0, z), (x, 0, -z), (-x, 0, -z)), floor),
        Mesh(*quad((-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)), plaster),
        Mesh(*quad((-x, 0, -z), (x, 0, -z), (x, y, -z), (-x, y, -z)), plaster),
        Mesh(*quad((x, 0, z), (-x, 0, z), (-x, y, z), (x, y, z)), plaster),
        Mesh(*quad((-x, 0, z), (-x, 0, -z), (-x, y, -z), (-x, y, z)), plaster),
        Mesh(*quad((x, 0, -z), (x, 0, z), (x, y, z), (x, y, -z)), plaster),
    ]
    for row in (-4.5, -1.5, 1.5, 4.5):
        meshes += [Mesh(*box((side, y / 2, row), (0.5, y, 0.5)), plaster) for side in (-2.2, 2.2)]
        meshes += [Mesh(*box((side, 0.35, row - 1.5), (1.4, 0.7, 0.9), 0.2 * row), wood) for side in (-3.6, 0.0, 3.6)]
    for column in range(10):
        for row in range(20):
            place = np.array([-4.5 + column, 0, -6.65 + 0.7 * row]) + random.uniform(-0.2, 0.2, 3)
            size = random.uniform(0.01, 0.04)
            watts = 10 ** random.uniform(-1, 1)
            tint = np.array([1.0, random.uniform(0.6, 1.0), random.uniform(0.3, 1.0)])
            if (column + row) % 4:  # a square on the ceiling
                a, b = (place[0], y - 0.01, place[2]), size
                shape = quad((a[0] - b, a[1], a[2] - b), (a[0] + b, a[1], a[2] - b), (a[0] + b, a[1], a[2] + b), (a[0] - b, a[1], a[2] + b))
                area = 4 * size**2
            else:  # a bulb on a long cord
                place[1] = random.uniform(1.2, 2.5)
                shape, area = sphere(4, size, place), 4 * np.pi * size**2
            meshes.append(Mesh(*shape, Material((0, 0, 0), emission=tuple(tint * watts / (np.pi * area)))))
    return Scene(meshes, (0.6, 1.7, 6.6), (-0.2, 1.2, 0), 0.95)


def field400():
    """400 placements of one mesh of 50 k triangles under a sky with a small sun."""

    def bumps(theta, phi):
        return 1 + 0.2 * np.sin(5 * phi) * np.sin(4 * theta) + 0.06 * np.sin(31 * phi) * np.cos(29 * theta)

    random = np.random.default_rng(2)
    shrub = Mesh(*sphere(112, 0.5, (0, 0.45, 0), bumps), Material((0.25, 0.45, 0.15)))
    for column in range(20):
        for row in range(20):
            x, z = np.array([column - 9.5, row - 9.5]) * 1.1 + random.uniform(-0.2, 0.2, 2)
            shrub.places.append(Place((x, 0, z), random.uniform(0, 2 * np.pi), random.uniform(0.6, 1.2)))
    ground = quad((-15, 0, 15), (15, 0, 15), (15, 0, -15), (-15, 0, -15))
    return Scene([shrub, Mesh(*ground, Material((0.5, 0.42, 0.35)))], (0, 4, 13), (0, 0, 1), 0.7, sky=True)


def between(low, high):
    """A box between two corners."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    return box((low + high) / 2, high - low)


def room(x, y, z, plaster, floor):
    """Thick walls about a room from -x to x, 0 to y and -z to z; the right one is left out."""
    t = 0.2
    parts = [
        (between((-x - t, -t, -z - t), (x + t, 0, z + t)), floor),
        (between((-x - t, y, -z - t), (x + t, y + t, z + t)), plaster),
        (between((-x - t, 0, -z - t), (-x, y, z + t)), plaster),
        (between((-x, 0, -z - t), (x + t, y, -z)), plaster),
        (between((-x, 0, z), (x + t, y, z + t)), plaster),
    ]
    return [Mesh(*shape, material) for shape, material in parts]


def right_wall(x, y, z, plaster, low, high, near, far):
    """The wall that `room` leaves out, with an opening from `low` to `high` and from `near` to `far` along z."""
    parts = (
        ((0, y), (-z, near)),
        ((0, y), (far, z)),
        ((0, low), (near, far)),
        ((high, y), (near, far)),
    )
    return [Mesh(*between((x, bottom, front), (x + 0.2, top, back)), plaster) for (bottom, top), (front, back) in parts]


def panel(x, front, emission):
    """A lamp as large as a wall at x, that shines toward -x."""
    vertices, triangles = quad((x, -1, front), (x, -1, -5), (x, 6, -5), (x, 6, front))
    return Mesh(vertices, triangles[:, ::-1], Material((0, 0, 0), emission=emission))


def slit():
    """A room that a bright panel lights through a slit of 12 cm in a thick wall."""
    plaster, floor, clay = Material((0.72, 0.7, 0.66)), Material((0.34, 0.22, 0.13)), Material((0.55, 0.27, 0.16))
    tin = Material((0.78, 0.77, 0.75), True, 0.35)
    x, y, z = 2.3, 2.7, 2.6
    meshes = room(x, y, z, plaster, floor) + right_wall(x, y, z, plaster, 0.5, 2.3, -1.05, -0.93)
    meshes += [
        Mesh(*between((-2, 0, -2.4), (0.2, 0.45, -1.7)), floor),
        Mesh(*sphere(32, 0.32, (-0.4, 0.32, -0.6)), clay),
        Mesh(*sphere(32, 0.22, (-1.3, 0.67, -2.05)), tin),
        Mesh(*between((0.85, 0, -2.25), (1.55, 1.1, -1.55)), plaster),
        panel(4, 3, (400, 450, 520)),
    ]
    return Scene(meshes, (-0.2, 1.4, 2.4), (0, 0.95, -1.4), 0.942)


def ajar():
    """A lamp in the next room, whose door stands ajar."""
    plaster, tiles, oak = Material((0.74, 0.72, 0.69)), Material((0.42, 0.39, 0.35)), Material((0.36, 0.24, 0.14))
    green, steel = Material((0.2, 0.42, 0.24)), Material((0.62, 0.62, 0.64), True, 0.4)
    lamp = Material((0, 0, 0), emission=(2700, 2280, 1680))
    x, y, z = 4.0, 2.7, 2.3
    near, far, lintel = 0.5, -0.4, 2.05
    leaf = between((-0.02, 0.01, far - near + 0.02), (0.02, lintel - 0.01, 0))
    door = turn(leaf[0], 0.42) + (0.97, 0, near)
    parts = [
        (between((x, 0, -z), (x + 0.2, y, z)), plaster),
        (between((0.9, 0, -z), (1.05, y, far)), plaster),
        (between((0.9, 0, near), (1.05, y, z)), plaster),
        (between((0.9, lintel, far), (1.05, y, near)), plaster),
        ((door, leaf[1]), oak),
        (quad((3.2, y - 0.04, -1), (3.7, y - 0.04, -1), (3.7, y - 0.04, -0.5), (3.2, y - 0.04, -0.5)), lamp),
        (between((-2.2, 0.66, -1.8), (-0.6, 0.72, -0.9)), oak),
        (between((-0.15, 0, -2.15), (0.55, 0.6, -1.65)), green),
        (sphere(28, 0.16, (-1.05, 0.88, -1.3)), green),
        (sphere(28, 0.16, (-1.7, 0.88, -1.35)), steel),
    ]
    meshes = room(x, y, z, plaster, tiles) + [Mesh(*shape, material) for shape, material in parts]
    return Scene(meshes, (-2.6, 1.5, 2.1), (-0.7, 0.95, -1.2), 1.01)


def cone(top, bottom, height, center, sides=24):
    """A lampshade: the side of a truncated cone with a lid, open below; `center` is that of the opening."""
    angle = np.arange(sides + 1) / sides * 2 * np.pi
    ring = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], -1)
    vertices = np.concatenate([bottom * ring, top * ring + [0, height, 0], [[0, height, 0]]])
    a, wide = np.arange(sides), sides + 1
    lid = np.stack([a + wide, a + wide + 1, np.full(sides, 2 * wide)], -1)
    side = np.concatenate([np.stack([a, a + 1, a + wide], -1), np.stack([a + 1, a + wide + 1, a + wide], -1)])
    return vertices + center, np.concatenate([side, lid])


def pendants():
    """A dining room with twelve bulbs, each in an opaque shade that is open below."""
    plaster, floor, wood = Material((0.75, 0.73, 0.7)), Material((0.3, 0.25, 0.2)), Material((0.4, 0.24, 0.12))
    enamel, steel = Material((0.6, 0.6, 0.58)), Material((0.6, 0.6, 0.62), True, 0.4)
    x, y, z = 3.2, 2.8, 3.6
    meshes = room(x, y, z, plaster, floor)
    meshes.append(Mesh(*between((x, 0, -z), (x + 0.2, y, z)), plaster))
    for row, depth in enumerate((-2.4, -0.8, 0.8, 2.2)):
        for column, across in enumerate((-2.0, 0.0, 2.0)):
            hung = (across, 1.55 + 0.1 * ((row + 2 * column) % 3), depth)
            warm = (1.0, 0.8 + 0.05 * column, 0.5 + 0.1 * row)
            bulb = Material((0, 0, 0), emission=tuple(120 * c for c in warm))
            meshes.append(Mesh(*cone(0.05, 0.17, 0.2, hung), enamel))
            meshes.append(Mesh(*sphere(8, 0.035, (hung[0], hung[1] + 0.1, hung[2])), bulb))
        meshes.append(Mesh(*between((-2.6, 0.72, depth - 0.35), (2.6, 0.76, depth + 0.35)), wood))
        meshes.append(Mesh(*sphere(24, 0.12, (0.9 - 0.6 * row, 0.88, depth)), steel))
    return Scene(meshes, (-2.7, 1.9, 3.3), (0.3, 0.8, -1.2), 1.05)


def blinds():
    """A room behind a window with closed blinds, lit by a bright panel outside."""
    plaster, floor, clay = Material((0.74, 0.73, 0.7)), Material((0.36, 0.27, 0.18)), Material((0.5, 0.25, 0.17))
    slat, tin = Material((0.6, 0.58, 0.55)), Material((0.7, 0.7, 0.68), True, 0.4)
    x, y, z = 2.4, 2.7, 2.6
    low, high, near, far = 0.8, 2.2, -1.6, 0.8
    meshes = room(x, y, z, plaster, floor) + right_wall(x, y, z, plaster, low, high, near, far)
    for k in range(28):  # slats of 6 cm, tilted by 49 degrees: the inner edge is the higher one
        height = low + 0.025 + 0.05 * k
        inner, outer = (x + 0.08, height + 0.023), (x + 0.12, height - 0.023)
        shape = quad((*inner, far), (*outer, far), (*outer, near), (*inner, near))
        meshes.append(Mesh(*shape, slat))
    meshes += [
        Mesh(*between((-1.9, 0, -2.3), (0.3, 0.45, -1.5)), floor),
        Mesh(*sphere(32, 0.3, (-0.3, 0.3, -0.5)), clay),
        Mesh(*sphere(32, 0.2, (-1.2, 0.65, -1.9)), tin),
        panel(4.5, 4, (60, 66, 75)),
    ]
    return Scene(meshes, (-1.0, 1.4, 2.4), (0.4, 0.9, -1.4), 0.95)


SCENES = {build.__name__: build for build in (cornell, veach, blob, lamps, field400, slit, ajar, pendants, blinds)}


def sky_bytes(width=512, height=256):
    """A blue sky with a sun of three by three texels, as RGBE, rows from the top."""
    up = np.linspace(1, 0, height)[:, None]
    rgb = np.stack([0.3 + 0.2 * up, 0.5 + 0.2 * up, 0.9 + 0 * up], -1) * np.ones((1, width, 1))
    rgb[60:63, 100:103] = 3000
    exponent = np.ceil(np.log2(rgb.max(-1)))
    mantissa = np.clip(rgb * (256 / 2.0**exponent)[..., None], 0, 255)
    return np.concatenate([mantissa, (exponent + 128)[..., None]], -1).astype(np.uint8)


def sky():
    """What a reader of a sky's file sees: (height, width, 3), texel centres at half-integers."""
    rgbe = sky_bytes().astype(np.float32)
    return (rgbe[..., :3] * 2.0 ** (rgbe[..., 3:] - 136)).astype(np.float32)


def write_all(folder, names):
    """Writes scenes, or copies those of others, named by their .glb, with the .hdr beside them. Returns their names."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name in map(Path, names):
        target = folder / f"{name.stem}.glb"
        if name.suffix:
            for file in filter(Path.exists, (name, name.with_suffix(".hdr"))):
                (folder / file.name).write_bytes(file.read_bytes())
            continue
        scene = SCENES[name.name]()
        scene.write(target)
        if scene.sky:
            rgbe = sky_bytes()
            header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {rgbe.shape[0]} +X {rgbe.shape[1]}\n"
            target.with_suffix(".hdr").write_bytes(header.encode() + rgbe.tobytes())
    return [Path(name).stem for name in names]


if __name__ == "__main__":
    write_all(sys.argv[1], sys.argv[2:] or SCENES)
