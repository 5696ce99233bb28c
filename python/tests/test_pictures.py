"""Pictures: the bits of the command line, as arrays and in files."""

import json
import subprocess

import numpy as np
import OpenEXR
import pytest

import bismar

ALL = ["albedo", "normal", "depth", "direct", "indirect", "variance", "samples", "balance", "object", "material"]
ALL += ["position", "uv", "emission", "guide-albedo", "guide-normal", "lights", "crypto-object", "crypto-material"]


def channels(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def same(a, b):
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def test_arrays_and_files_have_the_bits_of_the_command_line(cornell, scenes, program, tmp_path):
    line = [program, "-q", "render", scenes / "cornell.glb", "--size", "50x35", "--spp", "20", "--seed", "7", "--aov", "all"]
    subprocess.run([*line, "-o", tmp_path / "cli.exr", "--preview", tmp_path / "cli.png"], check=True)
    picture = cornell.render(size=(50, 35), spp=20, seed=7, aovs="all")
    picture.save(tmp_path / "python.exr")
    picture.save(tmp_path / "python.png")
    ours, theirs = channels(tmp_path / "python.exr"), channels(tmp_path / "cli.exr")
    assert ours.keys() == theirs.keys() and len(ours) > 60
    assert all(same(ours[name], theirs[name]) for name in ours)
    assert (tmp_path / "python.png").read_bytes() == (tmp_path / "cli.png").read_bytes()
    # The arrays hold the same values as the file.
    assert picture.layers == ["beauty", *ALL]
    seen = 0
    for layer in picture:
        array, names = picture[layer], picture.channels(layer)
        assert array.shape == (35, 50, len(names))
        for i, name in enumerate(names):
            if layer in ("lights", "crypto-object", "crypto-material"):
                continue
            prefix = "" if layer == "beauty" else layer.replace("-", "_") + "."
            assert same(np.ascontiguousarray(array[..., i]), theirs[prefix + name]), (layer, name)
            seen += 1
    assert seen == 4 + 3 + 3 + 1 + 3 + 3 + 3 + 1 + 1 + 1 + 1 + 3 + 2 + 3 + 3 + 3
    assert same(picture["light_surfaces"], np.ascontiguousarray(picture["lights"][..., 3:6]))


@pytest.mark.parametrize(
    "options",
    [
        dict(balance="half", max_depth=3, filter="box", crop=(3, 4, 20, 19)),
        dict(balance="second-order", pilot=0.25, guiding="on"),
        dict(noise=0.4, transparent=True, aperture="f/2.8", focus=2.5, clamp_indirect=0.5),
        dict(camera="framed", integrator="direct", adaptive=True),
        dict(orbit=(20, 30, 2), ground="shadow"),
    ],
)
def test_every_kind_of_option_arrives(cornell, scenes, program, tmp_path, options):
    flags = []
    for name, value in options.items():
        text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        flags.append(f"--{name.replace('_', '-')}" + ("" if value is True else f"={text}"))
    line = [program, "-q", "render", scenes / "cornell.glb", "--size", "32x24", "--spp", "24", *flags]
    subprocess.run([*line, "-o", tmp_path / "cli.exr"], check=True)
    picture = cornell.render(size="32x24", spp=24, **options)
    picture.save(tmp_path / "python.exr")
    ours, theirs = channels(tmp_path / "python.exr"), channels(tmp_path / "cli.exr")
    assert ours.keys() == theirs.keys() and all(same(ours[name], theirs[name]) for name in ours)
    # The command line takes it for its own picture: there is nothing left to do.
    again = subprocess.run(
        [*line[:1], *line[2:], "-o", tmp_path / "python.exr", "--resume"], check=True, capture_output=True, text=True
    )
    assert "nothing to do" in again.stderr


def test_ids_and_counts_are_whole_numbers_and_the_array_is_made_once(cornell):
    picture = cornell.render(size=(20, 10), spp=4, aovs=["object", "samples", "depth"])
    assert picture["object"].dtype == picture["samples"].dtype == np.uint32
    assert (picture["samples"] == 4).all() and picture["object"].max() > 1
    assert picture["depth"].dtype == np.float32
    assert picture["depth"] is picture["depth"] and picture["depth"].flags.writeable
    assert picture["beauty"].flags.c_contiguous
    with pytest.raises(KeyError, match="there are beauty, depth, samples, object"):
        picture["normal"]
    assert "depth" in picture and "normal" not in picture and picture.size == (20, 10)


def test_a_picture_outlives_its_scene(scenes):
    picture = bismar.load(scenes / "cornell.glb").render(size=(16, 16), spp=2)
    assert np.isfinite(picture["beauty"]).all() and picture["beauty"].mean() > 0


def test_compare_merge_and_develop(cornell, program, tmp_path):
    one, two = (cornell.render(size=(32, 32), spp=64, seed=seed) for seed in (1, 2))
    for name, picture in (("one", one), ("two", two)):
        picture.save(tmp_path / f"{name}.exr", resumable=True)
    assert bismar.compare(one, tmp_path / "one.exr")["rel_mse"] == 0.0
    found = bismar.compare(one, two)
    assert found["rel_mse"] > 0 and found["width"] == 32
    # Independent renders: |z| beyond 5 once in 580,000 for each of three channels.
    assert max(abs(z) for z in found["statistics"]["bias_z"]) < 5
    bismar.merge([tmp_path / "one.exr", tmp_path / "two.exr"], tmp_path / "both.exr", preview=tmp_path / "both.png")
    both = channels(tmp_path / "both.exr")
    mean = (one["beauty"][..., 0].astype(np.float64) + two["beauty"][..., 0]) / 2
    assert np.allclose(both["R"], mean, rtol=1e-5, atol=1e-7)
    bismar.develop(tmp_path / "both.exr", exposure=1.5, view="srgb")
    line = [program, "-q", "develop", tmp_path / "both.exr", "-o", tmp_path / "cli.png", "--exposure=1.5", "--view=srgb"]
    subprocess.run(line, check=True)
    assert (tmp_path / "both.png").read_bytes() == (tmp_path / "cli.png").read_bytes()


def test_a_picture_without_guides_is_not_denoised(cornell):
    with pytest.raises(bismar.UsageError, match="denoise"):
        cornell.render(size=(8, 8), spp=2).denoise()


def test_statistics_are_those_of_the_command_line(cornell):
    stats = cornell.render(size=(16, 8), spp=5).stats
    assert stats["samples"]["pixel_mean"] == 5 and stats["settings"]["width"] == 16 and stats["stop"] == "samples"


def test_labels_are_what_numpy_reads(cornell, tmp_path):
    picture = cornell.render(size=(20, 12), spp=2, aovs=["depth", "normal", "object"])
    picture.save(tmp_path / "a.exr")
    bismar.labels([tmp_path], tmp_path / "coco.json", ids=True, depth=["npy", "png"], normals=["npy"], normal_space="world")
    assert same(np.load(tmp_path / "a.depth.npy"), np.ascontiguousarray(picture["depth"][..., 0]))
    assert same(np.load(tmp_path / "a.normal.npy"), picture["normal"])
    assert (tmp_path / "a.depth.png").exists() and (tmp_path / "a.object.png").exists()
    masks = json.loads((tmp_path / "coco.json").read_text())["annotations"]
    assert sum(mask["area"] for mask in masks) == (picture["object"] > 0).sum()
    with pytest.raises(bismar.UsageError):
        bismar.labels([tmp_path / "a.exr"], depth=["exr"])
