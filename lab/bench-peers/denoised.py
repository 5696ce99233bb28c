"""Error and time of denoised pictures, Bismar's with and without path re-use beside Cycles', all by Open Image Denoise.

`BISMAR_OIDN=LIBRARY denoised.py --runs 2 --reference-spp 1024 >TABLE.csv` takes the options of bench.py. FLIP is `bismar compare`'s.
"""

import contextlib
import csv
import json
import subprocess
import sys

import bench
import numpy as np
import renderers
import scenes

import mitsuba as mi

WAYS = ("off", "2", "4", "8", "64:16", "64:32")


def flip(bismar, image, truth):
    a, b = (f"{renderers.PICTURE}-{name}.exr" for name in "ab")
    for path, pixels in ((a, image), (b, truth)):
        mi.Bitmap(np.float32(pixels)).write(path)
    return json.loads(subprocess.run([bismar, "compare", a, b, "--json"], check=True, capture_output=True).stdout)["flip"]


def measure(opt, scene, out):
    """A row per number of paths and way: medians over the runs. Bismar's CPU seconds leave out what one path takes, with its
    denoising; Cycles' leave out what it takes with one path, with its own."""
    truth = bench.references(opt, scene)
    opt.denoise = True
    ways = {way: renderers.Bismar(opt, scene, ["--path-reuse", way]) for way in WAYS}
    ways |= {peer: renderers.start(peer, opt, scene) for peer in opt.peers}
    opt.denoise = False
    for spp in opt.spp:
        results = {way: [] for way in ways}
        for run in range(opt.runs):
            for way, renderer in ways.items():
                image, took = renderer.render(spp, run + 1)
                reference = truth["bismar" if way in WAYS else way]
                results[way].append((reference.error(image), flip(opt.bismar, image, reference.mean), took["cpu"]))
        for way, values in results.items():
            out.writerow([scene, spp, way, *(f"{value:.4g}" for value in np.median(values, axis=0))])
        sys.stdout.flush()
    for renderer in ways.values():
        renderer.close()


def main():
    out = csv.writer(sys.stdout)
    with contextlib.redirect_stdout(sys.stderr):
        opt = bench.options()
        opt.scenes = scenes.write_all(opt.work / "scenes", opt.scenes)
    out.writerow(["scene", "paths", "way", "relmse", "flip", "cpu_seconds"])
    for scene in opt.scenes:
        measure(opt, scene, out)


if __name__ == "__main__":
    main()
