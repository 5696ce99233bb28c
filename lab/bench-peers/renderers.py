"""Bismar and its peers behind one method: `render(spp, seed)` gives the picture and what it took."""

import glob
import json
import os
import resource
import subprocess
import time
from pathlib import Path

import numpy as np

import mitsuba as mi

mi.set_variant("scalar_rgb")
HERE = Path(__file__).parent
PICTURE = f"/dev/shm/bench-peers-{os.getpid()}"


class Bismar:
    """One process a render. Seconds are those of its passes; CPU seconds leave out what a render of one sample takes."""

    def __init__(self, options, scene, flags=()):
        file = options.work / "scenes" / f"{scene}.glb"
        self.command = [options.bismar, "render", str(file), "-q", "--energy-compensation", "off"]
        self.command += ["--size", f"{options.size}x{options.size}", "--max-depth", str(options.depth)]
        self.command += ["--filter", "box", "-o", f"{PICTURE}.exr", "--stats", f"{PICTURE}.json"]
        if file.with_suffix(".hdr").exists():
            self.command += ["--env", str(file.with_suffix(".hdr"))]
        self.command += [*options.bismar_flags.split(), *flags, *["--denoise", "oidn"][: 2 * options.denoise]]
        self.setup, self.fixed_cpu = None, 0.0
        self.fixed_cpu = min(self.render(1, seed)[1]["cpu"] for seed in range(2))

    def render(self, spp, seed):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([*self.command, "--spp", str(spp), "--seed", str(seed)], check=True, stderr=subprocess.PIPE)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        stats = json.loads(Path(f"{PICTURE}.json").read_text())
        self.setup = stats["seconds"]["read"] + stats["seconds"]["build"]
        took = {
            "seconds": stats["seconds"]["render"],
            "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime - self.fixed_cpu,
            "peak_mib": stats["peak_memory_bytes"] >> 20,
        }
        layers = dict(mi.Bitmap(f"{PICTURE}.exr").split())
        image = np.array(next(layers[name] for name in ("denoised", "", "<root>") if name in layers), np.float32)[..., :3]
        os.remove(f"{PICTURE}.exr")
        os.remove(f"{PICTURE}.json")
        return image, took

    def close(self):
        pass


class Worker:
    """A peer in a process of its own that renders one scene again and again."""

    def __init__(self, python, script, arguments, environment):
        self.process = subprocess.Popen(
            [python, HERE / script, json.dumps(arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=os.environ | environment,
        )
        self.setup = self.answer()["setup"]

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"{self.process.args[1]} ended with code {self.process.wait()}; run it alone to see why")
        return json.loads(line)

    def render(self, spp, seed):
        self.process.stdin.write(f"{spp} {seed} {PICTURE}.npy\n")
        self.process.stdin.flush()
        took = self.answer()
        image = np.load(f"{PICTURE}.npy")
        os.remove(f"{PICTURE}.npy")
        return image, took

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def start(name, options, scene):
    """The renderer `name` with a scene loaded."""
    common = {"scene": scene, "folder": str(options.work / "scenes"), "size": options.size, "depth": options.depth}
    if name == "bismar":
        return Bismar(options, scene)
    python = options.work / name / "bin/python"
    if name == "mitsuba":
        llvm = os.environ.get("DRJIT_LIBLLVM_PATH") or next(iter(glob.glob(f"{options.work}/llvm/usr/lib/*/libLLVM.so.19*")))
        arguments = common | {"roulette": options.peer_roulette, "flatten": False}
        return Worker(python, "mitsuba_peer.py", arguments, {"DRJIT_LIBLLVM_PATH": llvm})
    return Worker(python, "cycles_peer.py", common | {"denoise": options.denoise}, {})


def rel_mse(image, reference):
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))


class Converged:
    """The mean of `batches` renders with seeds of their own, and how far it may be from the truth."""

    BATCHES = 16

    def __init__(self, name, options, scene):
        path = options.work / "references" / f"{scene}-{name}-{options.size}-{options.depth}-{options.reference_spp}.npz"
        if not path.exists():
            self.make(path, name, options, scene)
        stored = np.load(path)
        self.mean, self.variance, self.batch_means = stored["mean"], stored["variance"], stored["batch_means"]
        self.spp = options.reference_spp
        self.noise = float(np.mean(self.variance / (self.mean**2 + 0.01)))

    def error(self, image):
        """relMSE; what this picture is off itself is in the difference, and known."""
        return max(rel_mse(image, self.mean) - self.noise, 0.0)

    def make(self, path, name, options, scene):
        path.parent.mkdir(parents=True, exist_ok=True)
        print(f"{scene}: converged picture by {name}, {options.reference_spp} spp", flush=True)
        renderer = start(name, options, scene)
        start_time = time.perf_counter()
        # Seeds of the batches and of the measured runs are far apart.
        pictures = [renderer.render(options.reference_spp // self.BATCHES, 1000 + k)[0] for k in range(self.BATCHES)]
        renderer.close()
        print(f"{scene}: {time.perf_counter() - start_time:.0f} s", flush=True)
        batches = np.stack(pictures).astype(np.float64)
        variance = batches.var(axis=0, ddof=1) / self.BATCHES
        np.savez(path, mean=batches.mean(axis=0), variance=variance, batch_means=batches.mean(axis=(1, 2)))
