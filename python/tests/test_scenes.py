"""Scenes and cameras."""

import math
import subprocess

import numpy as np
import pytest

import bismar


def test_bounds_and_cameras_and_contents(cornell):
    low, high = cornell.bounds
    assert all(a < b for a, b in zip(low, high))
    first, *_, last = cornell.cameras
    assert first.index == 0 and first.projection == "perspective" and 0 < first.vertical < 180
    assert last.name == "framed"
    inspected = cornell.inspect()
    assert inspected["cameras"][0]["name"] == first.name
    assert np.allclose(inspected["cameras"][0]["position"], [row[3] for row in first.matrix[:3]])


def test_an_added_camera_with_a_files_matrix_makes_the_files_picture(scenes):
    scene = bismar.load(scenes / "cornell.glb")
    given = scene.cameras[0]
    added = scene.add_camera(np.array(given.matrix), given.vertical, name="mine")
    assert added.index == len(scene.cameras) - 1 and scene.cameras[added.index].name == "mine"
    expected = scene.render(given, (24, 24), spp=8)["beauty"]
    for camera in (added, "mine", added.index):
        # The matrix has passed through 32-bit floats; a rounded rotation may shift a ray by a millionth.
        assert np.allclose(scene.render(camera, (24, 24), spp=8)["beauty"], expected, atol=0.02)


def test_depth_from_an_added_camera_is_the_distance_along_its_rays(scenes):
    scene = bismar.load(scenes / "cornell.glb")
    (x0, y0, z0), (x1, y1, z1) = scene.bounds
    eye = np.array([(x0 + x1) / 2, (y0 + y1) / 2, z1 + 2 * (z1 - z0)])
    matrix = np.eye(4)
    matrix[:3, 3] = eye
    picture = scene.render(scene.add_camera(matrix, 20.0), (33, 33), spp=32, aovs=["depth", "position"], filter="box")
    depth, position = picture["depth"][..., 0], picture["position"]
    hit = depth < 1e9
    assert hit.sum() > 100
    middle = (16, 16)
    assert hit[middle]
    # Means over a pixel's paths: of the distance, and the distance of the mean, which differ by the pixel's extent.
    across = 2 * math.tan(math.radians(10)) / 33 * depth[middle]
    assert abs(np.linalg.norm(position[middle] - eye) - depth[middle]) < across
    assert np.allclose(picture.camera_to_world, matrix)


@pytest.mark.parametrize(
    "matrix, fov, why",
    [
        (np.eye(3), 40, "4 x 4"),
        ("text", 40, "4 x 4"),
        (np.diag([2, 2, 2, 1]), 40, "no rotation"),
        (np.diag([-1, 1, 1, 1]), 40, "no rotation"),
        (np.full((4, 4), np.nan), 40, "not finite"),
        (np.eye(4), 180, "field of view"),
        (np.eye(4), float("nan"), "field of view"),
        (np.eye(4), "wide", "neither degrees"),
    ],
)
def test_wrong_cameras_are_refused(cornell, matrix, fov, why):
    before = len(cornell.cameras)
    with pytest.raises(bismar.UsageError, match=why):
        cornell.add_camera(matrix, fov)
    assert len(cornell.cameras) == before


def test_orbits_and_panoramas_are_those_of_the_command_line(cornell, scenes, program, tmp_path):
    line = [program, "-q", "render", scenes / "cornell.glb", "--spp=4", "--size=32x16", "-o", tmp_path / "cli.exr"]
    for options, flags in [
        (dict(orbit=(30, -10, 0.7)), ["--orbit=30,-10,0.7"]),
        (dict(camera="panorama"), ["--camera=panorama"]),
    ]:
        subprocess.run([*line, *flags], check=True)
        cornell.render(size=(32, 16), spp=4, **options).save(tmp_path / "python.exr")
        assert bismar.compare(tmp_path / "python.exr", tmp_path / "cli.exr")["mae"] == 0.0


def test_an_added_panorama_sees_all_around(scenes):
    scene = bismar.load(scenes / "cornell.glb")
    (x0, y0, z0), (x1, y1, z1) = scene.bounds
    eye = np.array([x0 + x1, y0 + y1, z0 + z1]) / 2
    matrix = np.eye(4)
    matrix[:3, 3] = eye
    camera = scene.add_camera(matrix, "panorama")
    assert camera.projection == "panorama" and camera.aspect == 2
    picture = scene.render(camera, (64, 32), spp=1, aovs=["depth", "position"])
    depth, position = picture["depth"][..., 0].astype(float), picture["position"].astype(float)
    hit = depth < 1e9
    assert hit.sum() > 1000
    # One path per pixel: the depth is the distance of its hit.
    assert np.allclose(np.linalg.norm(position - eye, axis=-1)[hit], depth[hit], rtol=1e-5)
    # Left of the middle is -x, the top is +y; the filter reaches 2 pixels.
    u, v = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(32) + 0.5) / 32)
    longitude, latitude = (u - 0.5) * 2 * np.pi, (0.5 - v) * np.pi
    flat = np.cos(latitude)
    toward = np.stack([np.sin(longitude) * flat, np.sin(latitude), -np.cos(longitude) * flat], axis=-1)
    seen = (position - eye) / depth[..., None]
    assert (np.einsum("yxc,yxc->yx", toward, seen)[hit] > math.cos(3 * math.pi / 32)).all()


def test_two_cameras_of_one_name_are_refused(scenes):
    scene = bismar.load(scenes / "cornell.glb")
    scene.add_camera(np.eye(4), 40, name="a")
    with pytest.raises(bismar.UsageError, match="another camera"):
        scene.add_camera(np.eye(4), 40, name="a")


def test_the_pictures_of_a_placed_camera_are_not_those_of_another_to_the_command_line(scenes, program, tmp_path):
    scene = bismar.load(scenes / "cornell.glb")
    matrix = np.array(scene.cameras[0].matrix)
    scene.render(scene.add_camera(matrix, 50), (16, 16), spp=2).save(tmp_path / "a.exr")
    line = [program, "render", scenes / "cornell.glb", "--size=16x16", "--spp=2", "-o", tmp_path / "a.exr", "--resume"]
    refused = subprocess.run(line, capture_output=True, text=True)
    assert refused.returncode == 65 and "camera" in refused.stderr


def test_options_of_the_scene_are_those_of_the_command_line(scenes, program, tmp_path):
    scene = bismar.load(scenes / "cornell.glb", sky=True, env_strength=0.5, light_unit="watt", rays="obvhs")
    scene.render(size=(16, 16), spp=4).save(tmp_path / "a.exr")
    line = [program, "render", scenes / "cornell.glb", "--sky", "--env-strength=0.5", "--light-unit=watt", "--rays=obvhs"]
    line += ["--size=16x16", "--spp=4", "-o"]
    subprocess.run([*line, tmp_path / "b.exr"], check=True)
    assert bismar.compare(tmp_path / "a.exr", tmp_path / "b.exr")["mae"] == 0.0
    done = subprocess.run([*line, tmp_path / "a.exr", "--resume"], capture_output=True, text=True)
    assert "nothing to do" in done.stderr


def test_velocities_need_a_scene_that_was_loaded_for_them(cornell):
    with pytest.raises(bismar.UsageError, match="needs a time"):
        cornell.render(size=(8, 8), spp=1, aovs=["velocity"])
