"""LUTs, against OpenColorIO's own processor."""

import os

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import bismar

if os.environ.get("CI") == "true":
    import PyOpenColorIO as ocio
else:
    ocio = pytest.importorskip("PyOpenColorIO", reason="opencolorio is not installed (scripts/setup.sh --python)")

ACES2 = ("sRGB - Display", "ACES 2.0 - SDR 100 nits (Rec.709)")


@pytest.fixture(scope="module")
def colors():
    """Linear Rec. 709 of twenty stops, saturated and grey, and some outside of it."""
    chance = np.random.default_rng(7)
    rgb = np.exp2(chance.uniform(-12, 8, (60, 80, 1)) - chance.uniform(0, 4, (60, 80, 3)))
    rgb[:5] = np.exp2(np.linspace(-12, 8, 400)).reshape(5, 80, 1)
    rgb[5:10] -= 0.02
    return rgb.astype(np.float32)


def seen_by(config, transform, colors):
    found = np.ascontiguousarray(colors.reshape(-1, 3))
    config.getProcessor(transform).getDefaultCPUProcessor().applyRGB(found)
    return found.reshape(colors.shape)


@pytest.mark.parametrize(
    "kind, cube, shaper, space",
    [
        ("resolve_cube", 33, 0, "ACEScct"),
        ("resolve_cube", 17, 1024, "ACEScg"),
        ("iridas_cube", 33, 0, "ACEScct"),
        ("iridas_cube", 33, 0, "Linear Rec.709 (sRGB)"),
    ],
)
def test_pixels_are_those_of_opencolorio(tmp_path, colors, kind, cube, shaper, space):
    config = ocio.Config.CreateFromFile("ocio://default")
    baker = ocio.Baker()
    baker.setConfig(config)
    baker.setFormat(kind)
    baker.setInputSpace(space)
    baker.setDisplayView(*ACES2)
    baker.setCubeSize(cube)
    if shaper:
        baker.setShaperSpace("ACEScct")
        baker.setShaperSize(shaper)
    (tmp_path / "look.cube").write_text(baker.bake())
    pixels = {name: np.ascontiguousarray(colors[..., i]) for i, name in enumerate("RGB")}
    OpenEXR.File({"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}, pixels).write(str(tmp_path / "a.exr"))
    name = {"Linear Rec.709 (sRGB)": "rec709"}.get(space, space)
    bismar.develop(tmp_path / "a.exr", tmp_path / "a.png", view=tmp_path / "look.cube", view_space=name, exposure=0)
    ours = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"), float)
    transform = ocio.GroupTransform(
        [
            ocio.ColorSpaceTransform(src="Linear Rec.709 (sRGB)", dst=space),
            ocio.FileTransform(src=str(tmp_path / "look.cube"), interpolation=ocio.INTERP_TETRAHEDRAL),
        ]
    )
    theirs = 255 * np.clip(seen_by(config, transform, colors), 0, 1)
    # Dithered to one of the two bytes beside the value.
    assert np.abs(ours - theirs).max() <= 1.0 + 1e-2
    assert len(np.unique(ours)) > 100
