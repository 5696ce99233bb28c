"""Binary glTF, part by part: for the scenes of this folder."""

import json
import struct

FLOAT, SHORT, INT = 5126, 5123, 5125


class Glb:
    """A glTF document with its buffer."""

    def __init__(self, **more):
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], **more}
        self.bin = bytearray()

    def add(self, kind, **item):
        """Appends to one of the document's lists; returns the item's index."""
        items = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def accessor(self, data, kind, component=FLOAT, **more):
        """Elements from bytes."""
        self.bin += b"\0" * (-len(self.bin) % 4)
        view = self.add("bufferViews", buffer=0, byteOffset=len(self.bin), byteLength=len(data))
        self.bin += data
        size = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[kind] * (2 if component == SHORT else 4)
        return self.add("accessors", bufferView=view, componentType=component, type=kind, count=len(data) // size, **more)

    def mesh(self, vertices, triangles, material):
        """A mesh from NumPy arrays of vertices and of triangles."""
        vertices = vertices.astype("<f4")
        position = self.accessor(vertices.tobytes(), "VEC3", min=vertices.min(0).tolist(), max=vertices.max(0).tolist())
        indices = self.accessor(triangles.astype("<u4").tobytes(), "SCALAR", INT)
        return self.add("meshes", primitives=[{"attributes": {"POSITION": position}, "indices": indices, "material": material}])

    def node(self, shown=True, **item):
        index = self.add("nodes", **item)
        if shown:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def file(self):
        """The bytes of the whole."""
        binary = bytes(self.bin) + b"\0" * (-len(self.bin) % 4)
        text = json.dumps({**self.json, "buffers": [{"byteLength": len(binary)}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for kind, chunk in ((b"JSON", text), (b"BIN\0", binary)))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
