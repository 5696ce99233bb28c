"""Calibrated cameras: points are where OpenCV projects them."""

import base64
import json
import os

import numpy as np
import pytest

import bismar

if os.environ.get("CI") == "true":
    import cv2
else:
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed (scripts/setup.sh --python)")

SIZE = dict(w=1920, h=1080)
LENSES = {
    "pinhole": dict(camera_model="PINHOLE", fl_x=500, fl_y=520, cx=900.3, cy=610.7),
    "barrel": dict(
        camera_model="OPENCV", fl_x=1100, fl_y=1092, cx=942.2, cy=551.7, k1=-0.28, k2=0.09, k3=-0.012, p1=-8e-4, p2=5e-4
    ),  # fmt: skip
    "rational": dict(
        camera_model="FULL_OPENCV", fl_x=840, fl_y=862, cx=971.8, cy=533.3,
        k1=0.5, k2=0.06, k3=0.002, k4=0.8, k5=0.14, k6=0.006, p1=6e-4, p2=-4e-4,
    ),  # fmt: skip
    "fisheye": dict(
        camera_model="OPENCV_FISHEYE", fl_x=520, fl_y=523, cx=955.5, cy=546, k1=0.03, k2=-0.008, k3=0.004, k4=-4e-4
    ),  # fmt: skip
}


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A wall of 40 m at z = -2."""
    corners = np.array([[-20, -20, -2], [20, -20, -2], [20, 20, -2], [-20, 20, -2]], np.float32)
    data = corners.tobytes() + np.array([0, 1, 2, 0, 2, 3], np.uint32).tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-20, -20, -2], "max": [20, 20, -2]},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "buffers": [{"byteLength": 72, "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
    }
    path = tmp_path_factory.mktemp("wall") / "wall.gltf"
    path.write_text(json.dumps(document))
    return bismar.load(path)


def projected(lens, points):
    """Pixels from the upper left corner, of points in OpenCV's camera space."""
    k = [lens.get(f"k{i}", 0.0) for i in range(1, 7)]
    matrix = np.array([[lens["fl_x"], 0, lens["cx"]], [0, lens["fl_y"], lens["cy"]], [0, 0, 1.0]])
    points, zero = np.asarray(points, float).reshape(-1, 1, 3), np.zeros(3)
    if lens["camera_model"] == "OPENCV_FISHEYE":
        return cv2.fisheye.projectPoints(points, zero, zero, matrix, np.array(k[:4]))[0].reshape(-1, 2)
    k = np.array([k[0], k[1], lens.get("p1", 0.0), lens.get("p2", 0.0), *k[2:]])
    return cv2.projectPoints(points, zero, zero, matrix, k)[0].reshape(-1, 2)


@pytest.mark.parametrize("name", LENSES)
def test_points_are_where_opencv_projects_them(wall, name):
    lens = {**LENSES[name], **SIZE}
    # Turned about the view axis, and moved: OpenCV has x right, y down, z along the view.
    c, s = np.cos(np.radians(17)), np.sin(np.radians(17))
    matrix = np.array([[c, -s, 0, 0.3], [s, c, 0, -0.2], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    camera = wall.add_camera(matrix[:3], intrinsics=lens, name=name)
    assert camera.intrinsics.items() >= lens.items()
    widest, compared = 0.0, 0
    windows = [(x, y, x + 12, y + 12) for x in (0, 480, 954, 1400, 1908) for y in (0, 250, 800)]
    for x0, y0, x1, y1 in windows:
        # Means over each pixel: its points lie around its middle.
        picture = wall.render(camera, spp=128, crop=(x0, y0, x1, y1), filter="box", aovs=["position", "depth"], max_depth=2)
        hit = picture["depth"][..., 0] < 1e9
        rows, columns = np.nonzero(hit)
        points = (picture["position"][hit].astype(float) - matrix[:3, 3]) @ matrix[:3, :3] * [1, -1, -1]
        angles = np.degrees(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]))
        near = angles <= 60
        if not near.any():
            continue
        found = projected(lens, points)
        error = np.abs(found - np.stack([columns + x0 + 0.5, rows + y0 + 0.5], -1))[near]
        assert error.max() < 0.01, (x0, y0, error.max())
        widest, compared = max(widest, angles[near].max()), compared + near.sum()
    assert compared > 1000 and widest > (45 if name == "rational" else 55), (compared, widest)


def test_intrinsics_that_cannot_be_are_refused(wall):
    lens = {**LENSES["barrel"], **SIZE}
    for change, why in [
        (dict(k1=-0.9, k2=0), "folds the picture at"),
        (dict(k1=float("nan")), "not finite"),
        (dict(fl_x="a"), "intrinsics"),
    ]:
        with pytest.raises(bismar.UsageError, match=why):
            wall.add_camera(np.eye(4), intrinsics={**lens, **change})
    with pytest.raises(bismar.UsageError, match="either fov or intrinsics"):
        wall.add_camera(np.eye(4), 40, intrinsics=lens)
