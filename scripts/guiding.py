#!/usr/bin/env python3
"""What guiding is worth: relMSE x CPU seconds of --guiding auto over that of off, --balance half, one thread.

    scripts/guiding.py BISMAR [--spp 64,256] [--seeds 3] [--reference 1024] [SCENE ...] > table.md

A reference of other seeds, guided, says what pictures are compared with; its own error is in all numbers, and taken off by
what two such references differ by. CPU seconds are of the whole command but for reading and writing, learning included.
"""

import argparse
import json
import math
import os
import resource
import subprocess
import tempfile
from pathlib import Path

SCENES = Path(__file__).resolve().parent.parent / "scenes"
ALL = ["glossy-sun", "veach", "many-lights"] + [
    "study/" + name
    for name in "window screen slats mirrors night uplights brushed foliage slit ajar shade".split()
]


def cpu():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Bench:
    def __init__(self, program, size, folder):
        self.program, self.size, self.folder = program, size, folder

    def render(self, scene, guiding, spp, seed):
        """Picture, CPU seconds, and whether paths were guided."""
        out = f"{self.folder}/{guiding}-{spp}-{seed}"
        command = [self.program, "render", f"{SCENES}/{scene}.glb", "--size", self.size, "--spp", str(spp), "--seed", str(seed)]
        command += ["--balance", "half", "--guiding", guiding, "--threads", "1", "--aov", "none", "-q"]
        if (sky := SCENES / f"{scene}.hdr").exists():
            command += ["--env", str(sky)]
        before = cpu()
        subprocess.run(command + ["-o", out + ".exr", "--stats", out + ".json"], check=True, stderr=subprocess.DEVNULL)
        stats = json.loads(Path(out + ".json").read_text())
        idle = sum(stats["seconds"][phase] for phase in ("read", "build", "write"))
        return out + ".exr", max(cpu() - before - idle, 1e-3), stats.get("guiding")

    def rel_mse(self, a, b):
        command = [self.program, "compare", a, b, "--json"]
        return json.loads(subprocess.run(command, check=False, capture_output=True, text=True).stdout)["rel_mse"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("scenes", nargs="*", default=ALL)
    parser.add_argument("--spp", default="64,256")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--reference", type=int, default=1024)
    parser.add_argument("--size", default="192x128")
    parser.add_argument("--guiding", default="auto")
    args = parser.parse_intermixed_args()
    levels = [int(n) for n in args.spp.split(",")]
    products = {spp: [] for spp in levels}
    print("| scene | " + " | ".join(f"{spp} spp: relMSE of off, ratio of relMSE, of CPU s, product" for spp in levels) + " | guided |")
    print("| --- |" + " --- |" * (len(levels) + 1))
    for scene in args.scenes:
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(os.path.abspath(args.program), args.size, folder)
            references = [bench.render(scene, "on", args.reference, 900 + i)[0] for i in range(2)]
            own = bench.rel_mse(*references) / 2
            row, guided = [], None
            for spp in levels:
                error, seconds = {}, {}
                for guiding in ("off", args.guiding):
                    taken = [bench.render(scene, guiding, spp, seed) for seed in range(args.seeds)]
                    errors = [sum(bench.rel_mse(picture, r) for r in references) / 2 - own for picture, _, _ in taken]
                    error[guiding], seconds[guiding] = sum(errors) / len(errors), sum(t[1] for t in taken)
                    guided = taken[0][2]
                [e, t] = [x[args.guiding] / x["off"] for x in (error, seconds)]
                products[spp].append(e * t)
                row.append(f"{error['off']:.2e} {e:.2f} {t:.2f} **{e * t:.2f}**")
            told = f"yes ({guided['variance']:.2f})" if guided["on"] else f"no ({guided['variance']:.2f})"
            print(f"| {scene.removeprefix('study/')} | " + " | ".join(row) + f" | {told} |", flush=True)
    means = [math.exp(sum(map(math.log, p)) / len(p)) for p in products.values()]
    print("| geometric mean | " + " | ".join(f"**{m:.2f}**" for m in means) + " | |")


main()
