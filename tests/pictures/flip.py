"""FLIP of the pictures that tests/flip.rs makes, by its authors' program: flip.py, JSON on stdout. What it prints is recorded
in tests/flip.rs."""

import json
import sys

import flip_evaluator
import numpy

SIZE = (48, 37)


def picture(kind):
    """As `picture` in tests/flip.rs, in double precision rounded once."""
    height, width = SIZE[1], SIZE[0]
    y, x = numpy.mgrid[0:height, 0:width].astype(numpy.float64)
    out = numpy.zeros((height, width, 3))
    for c in range(3):
        wave = 0.5 + 0.5 * numpy.sin(0.37 * x * (c + 1) + 0.23 * y + c)
        out[..., c] = wave * (x / width) if kind != "hdr" else wave * numpy.exp2(8 * x / width - 3)
    return out.astype(numpy.float32)


def changed(pixels):
    out = pixels.copy()
    out[10:14, 20:30, 0] *= 0.5
    out[25, 40] = out[25, 40] * 0.25
    out[:, 5, 2] = out[:, 5, 2] * 0.75
    return out


numbers = {}
for kind in ["ldr", "hdr"]:
    reference = picture(kind)
    if kind == "ldr":  # Its input is sRGB; ours are linear.
        encode = lambda p: numpy.where(p <= 0.0031308, 12.92 * p, 1.055 * p ** (1 / 2.4) - 0.055).astype(numpy.float32)
        error, mean, _ = flip_evaluator.evaluate(encode(reference), encode(changed(reference)), "LDR", applyMagma=False)
    else:
        error, mean, found = flip_evaluator.evaluate(reference, changed(reference), "HDR", applyMagma=False)
        print(found, file=sys.stderr)
    error = error.reshape(SIZE[1], SIZE[0], -1)[..., 0]
    numbers[kind] = {"mean": float(mean), "most": float(error.max()),
                     "some": [float(error[y, x]) for y, x in [(12, 25), (25, 40), (0, 5), (36, 47), (18, 6)]]}
print(json.dumps(numbers, indent=1))
