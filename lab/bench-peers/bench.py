"""Renders the same scenes with Bismar and its peers, in turn, and writes what error each has after which time.

Run it as `make bench-peers` (BENCH_FLAGS="--quick" for a look); `bench.py --help` lists the options.
"""

import argparse
import csv
import os
from pathlib import Path

import numpy as np
import renderers
import scenes
from chart import chart

PEERS = ("mitsuba", "cycles")
INTERIORS = ("slit", "ajar", "pendants", "blinds")
IN_README = ("cornell", "veach", "lamps", "pendants")
TITLES = {"bismar": "Bismar", "mitsuba": "Mitsuba 3", "cycles": "Cycles"}


def options():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", default=",".join(scenes.SCENES), help="names and .glb files, separated by commas [%(default)s]")
    parser.add_argument("--peers", default=",".join(PEERS), help="[%(default)s]")
    parser.add_argument("--spp", default="16,64,256", help="samples a pixel; the table shows the middle one [%(default)s]")
    parser.add_argument("--runs", type=int, default=5, help="renders of each, in turn [%(default)s]")
    parser.add_argument("--size", type=int, default=256, help="pixels of a side [%(default)s]")
    parser.add_argument("--depth", type=int, default=8, help="most segments of a path [%(default)s]")
    parser.add_argument("--peer-roulette", type=int, default=1000, help="Mitsuba's rr_depth [%(default)s: none]")
    parser.add_argument("--reference-spp", type=int, default=8192, help="of the converged pictures [%(default)s]")
    parser.add_argument("--quick", action="store_true", help="one small spp, two runs, rough references, no files in lab/")
    parser.add_argument("--agreement", action="store_true", help="compare converged pictures instead; writes lab/peers.md's table")
    parser.add_argument("--bismar", default="target/release/bismar", help="[%(default)s]")
    parser.add_argument("--bismar-flags", default="", help="more flags for it")
    parser.add_argument("--work", type=Path, default=Path("target/peers"), help="peers, scenes, references [%(default)s]")
    parser.add_argument("--results", type=Path, default=Path("lab"), help="where results go [%(default)s]")
    if parser.parse_known_args()[0].quick:
        parser.set_defaults(spp="16", runs=2, reference_spp=1024)
    out = parser.parse_args()
    out.scenes, out.peers, out.spp = out.scenes.split(","), [p for p in out.peers.split(",") if p], [int(s) for s in out.spp.split(",")]
    installed = [peer for peer in out.peers if (out.work / peer / "bin/python").exists()]
    for peer in set(out.peers) - set(installed):
        print(f"{peer} is not installed in {out.work}: left out")
    out.peers, out.denoise = installed, False
    return out


def references(opt, scene):
    """The converged picture that each renderer is measured against."""
    # GGX is masked otherwise by each: with rough metal a renderer is measured against its own converged picture.
    own = {"bismar", *opt.peers} if scene in ("veach", "blob") or scene not in scenes.SCENES else set()
    # Where light comes by few ways, peers take too long to converge; --agreement tells whether all show the same.
    common = "bismar" if scene in INTERIORS else "mitsuba"
    of = {name: name if name in own else common for name in ["bismar", *opt.peers]}
    converged = {name: renderers.Converged(name, opt, scene) for name in sorted(set(of.values()))}
    return {name: converged[of[name]] for name in of}


def measure(opt, scene):
    """One row a render: every renderer takes its turn in every round."""
    reference = references(opt, scene)
    running = {name: renderers.start(name, opt, scene) for name in ["bismar", *opt.peers]}
    rows = []
    for spp in opt.spp:
        for run in range(opt.runs):
            for name, renderer in running.items():
                image, took = renderer.render(spp, run + 1)
                error = reference[name].error(image)
                paths = opt.size**2 * spp / took["seconds"]
                rows.append({
                    "scene": scene, "renderer": name, "spp": spp, "run": run, "seconds": took["seconds"],
                    "cpu_seconds": took["cpu"], "setup_seconds": renderer.setup, "mpaths_per_second": paths / 1e6,
                    "relmse": error, "inverse_efficiency": error * took["seconds"], "peak_mib": took["peak_mib"],
                })  # fmt: skip
        print(summary(rows, scene, spp), flush=True)
    for renderer in running.values():
        renderer.close()
    return rows


def column(rows, key, **where):
    return np.array([r[key] for r in rows if all(r[k] == v for k, v in where.items())])


def summary(rows, scene, spp):
    lines = []
    for name in dict.fromkeys(r["renderer"] for r in rows):
        of = {"scene": scene, "renderer": name, "spp": spp}
        seconds, cpu, error = (np.median(column(rows, key, **of)) for key in ("seconds", "cpu_seconds", "relmse"))
        lines.append(f"{scene} {spp} spp {name:8}{seconds:8.3f} s {cpu:7.2f} CPU s  relMSE {error:.5f}  {error * seconds:.6f}")
    return "\n".join(lines)


def spread(values, digits=2):
    low, middle, high = np.min(values), np.median(values), np.max(values)
    return f"{middle:.{digits}g} ({low:.{digits}g} to {high:.{digits}g})"


def table(rows, opt):
    """What is measured; per scene each renderer's numbers, and ours over the best peer's, round by round."""
    spp = opt.spp[len(opt.spp) // 2]
    lines = [
        "| scene | renderer | set-up s | seconds | processor s | Mpaths/s | relMSE | relMSE x seconds | peak MiB |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    ratios = [
        "| scene | best peer | relMSE x seconds, ours over the peer's | relMSE alone | seconds alone | processor s alone |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for scene in opt.scenes:
        for name in ["bismar", *opt.peers]:
            of = {"scene": scene, "renderer": name, "spp": spp}
            keys = ("setup_seconds", "cpu_seconds", "mpaths_per_second", "relmse", "peak_mib")
            setup, cpu, paths, error, peak = (np.median(column(rows, key, **of)) for key in keys)
            seconds, score = (spread(column(rows, k, **of), 3) for k in ("seconds", "inverse_efficiency"))
            lines.append(f"| {scene} | {TITLES[name]} | {setup:.2f} | {seconds} | {cpu:.2f} | {paths:.2f} | {error:.3g} | {score} | {peak:.0f} |")
        scores = {p: np.median(column(rows, "inverse_efficiency", scene=scene, renderer=p, spp=spp)) for p in opt.peers}
        if not scores:
            continue
        best = min(scores, key=scores.get)
        of = [{"scene": scene, "renderer": name, "spp": spp} for name in ("bismar", best)]
        ratio = [spread(np.divide(*(column(rows, k, **w) for w in of))) for k in ("inverse_efficiency", "relmse", "seconds", "cpu_seconds")]
        ratios.append(f"| {scene} | {TITLES[best]} | " + " | ".join(ratio) + " |")
    head = f"{opt.size} x {opt.size} pixels, {spp} spp, at most {opt.depth} segments, box filter; median (least to most) of {opt.runs} runs in turn."
    return head, "\n".join(lines), "\n".join(ratios)


def agreement(opt):
    """Converged pictures by us and by each peer: are they the same but for noise?"""
    lines = [
        "| scene | peer | spp of each | mean, ours | relMSE between them | expected from their noise | bias | z |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for scene in opt.scenes:
        ours = renderers.Converged("bismar", opt, scene)
        for peer in opt.peers:
            theirs = renderers.Converged(peer, opt, scene)
            expected = float(np.mean((ours.variance + theirs.variance) / (theirs.mean**2 + 0.01)))
            difference = ours.batch_means.mean(1) - theirs.batch_means.mean(1)
            bias = difference.mean()
            error = np.sqrt((ours.batch_means.mean(1).var(ddof=1) + theirs.batch_means.mean(1).var(ddof=1)) / ours.BATCHES)
            lines.append(
                f"| {scene} | {TITLES[peer]} | {ours.spp} | {ours.mean.mean():.5f} | {renderers.rel_mse(ours.mean, theirs.mean):.3g} "
                f"| {expected:.3g} | {bias:+.2e} | {bias / error:+.1f} |"
            )
            print(lines[-1], flush=True)
    return "\n".join(lines)


def insert(path, mark, text):
    """Replaces what stands between the marks in a document."""
    first, last = f"<!-- {mark} -->", f"<!-- /{mark} -->"
    page = path.read_text()
    path.write_text(page[: page.index(first) + len(first)] + f"\n{text}\n" + page[page.index(last) :])


def main():
    opt = options()
    opt.scenes = scenes.write_all(opt.work / "scenes", opt.scenes)
    if opt.agreement:
        text = agreement(opt)
        if not opt.quick:
            insert(opt.results / "peers.md", "agreement", text)
        return
    load = os.getloadavg()[0]
    rows = [row for scene in opt.scenes for row in measure(opt, scene)]
    head, each, ratios = table(rows, opt)
    print(f"\n{head}\n\n{each}\n\n{ratios}\n\nload before: {load:.1f}")
    folder = opt.work if opt.quick else opt.results
    with open(folder / "peers.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    points = {
        scene: {TITLES[n]: [(np.median(column(rows, "seconds", scene=scene, renderer=n, spp=s)), np.median(column(rows, "relmse", scene=scene, renderer=n, spp=s))) for s in opt.spp] for n in ["bismar", *opt.peers]}
        for scene in opt.scenes
    }  # fmt: skip
    (folder / "peers.svg").write_text(chart(points))
    (folder / "peers-readme.svg").write_text(chart({scene: points[scene] for scene in IN_README if scene in points}))
    if not opt.quick:
        insert(opt.results / "peers.md", "bench-peers", f"{head}\n\n{ratios}")


if __name__ == "__main__":
    main()
