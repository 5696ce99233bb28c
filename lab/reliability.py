#!/usr/bin/env python3
"""Kills, starves and misleads bismar, counts what was lost, and writes the counts into lab/reliability.md.

    reliability.py BINARY SECTION...     a section by name, or all; each replaces its own part of the page

A section counts tries and failures; the exit code is 1 if any failed. Needs nothing but Python 3.9.
"""

import importlib
import json
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import reliability_commands
import reliability_files
import reliability_memory
from reliability_files import environment

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "lab/reliability.md"
reader = importlib.import_module("same-bits")
HEAD = """# Reliability tests

Tries and failures, counted by `lab/reliability.py target/release/bismar all`; a section's name in place of
`all` repeats it. libFuzzer was measured by hand.
"""
SECTIONS = {}


def section(title):
    """A function that is given the program and a folder, and returns rows: (what, tries, failures, remark)."""
    def register(function):
        SECTIONS[function.__name__] = (title, function)
        return function
    return register


def run(bismar, folder, line, **more):
    words = line.split() if isinstance(line, str) else line
    return subprocess.run([bismar, *words], cwd=folder, env=environment(2, **more), capture_output=True, text=True)


def start(bismar, folder, line, **more):
    return subprocess.Popen([bismar, *line.split()], cwd=folder, env=environment(2, **more),
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def children(process):
    """Processes that this one has started."""
    try:
        return [int(n) for task in Path(f"/proc/{process}/task").iterdir()
                for n in (task / "children").read_text().split()]
    except OSError:
        return []


def kill(process, number=signal.SIGKILL):
    try:
        os.kill(process, number)
        return True
    except ProcessLookupError:
        return False


def glb(document, binary=b""):
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def hostile(folder):
    """Sixteen jobs that cannot be done, as lines of a batch file."""
    good = (folder / "scene.glb").read_bytes()
    asset = {"version": "2.0"}
    files = {
        "noise.glb": random.Random(7).randbytes(5000),
        "half.glb": good[:len(good) // 2],
        "empty.glb": b"",
        "deep.glb": glb(b'{"asset":' + b"[" * 200_000),
        "huge.glb": glb({"asset": asset, "buffers": [{"byteLength": 2**53}],
                         "bufferViews": [{"buffer": 0, "byteLength": 2**53}],
                         "accessors": [{"bufferView": 0, "componentType": 5126, "count": 2**49, "type": "VEC3"}],
                         "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                         "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}),
        "loop.glb": glb({"asset": asset, "nodes": [{"children": [1]}, {"children": [0]}], "scenes": [{"nodes": [0]}]}),
        "away.gltf": json.dumps({"asset": asset, "buffers": [{"uri": "../" * 40 + "dev/zero", "byteLength": 99}]}).encode(),
        "text.glb": glb(b"\xff\xfe\x00" * 20),
        "noise.exr": b"\x76\x2f\x31\x01\x02\0\0\0" + random.Random(8).randbytes(3000),
        "noise.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n" + random.Random(9).randbytes(3000),
        "foreign.exr": b"not a picture of ours",
    }
    for name, content in files.items():
        (folder / name).write_bytes(content)
    os.mkfifo(folder / "pipe.glb")
    (folder / "self.glb").symlink_to("self.glb")
    scenes = [name for name in files if name.endswith(("glb", "gltf"))] + ["absent.glb", "pipe.glb", "self.glb"]
    jobs = [f"scene = '{name}'" for name in scenes]
    jobs += ["scene = 'scene.glb'\nenv = 'noise.exr'", "scene = 'scene.glb'\nenv = 'noise.hdr'",
             "scene = 'scene.glb'\nsize = '65536x65536'", "scene = 'scene.glb'\ncamera = 'nobody'",
             "scene = 'scene.glb'\noutput = 'foreign.exr'"]
    return jobs[:16] if len(jobs) > 16 else jobs


@section("Batches")
def batch(bismar, folder):
    """60 jobs, 16 of them hostile, eight at a time; 25 kills of the batch or of one of its processes."""
    shutil.copy(ROOT / "scenes/veach.glb", folder / "scene.glb")
    bad = hostile(folder)
    good = 60 - len(bad)
    head = "[defaults]\nsize = '64x48'\nspp = 384\noutput = 'out/{name}.exr'\ncheckpoint = 0.5\n"
    jobs = [(f"good{n}", f"scene = 'scene.glb'\nseed = {n}") for n in range(good)]
    jobs += [(f"bad{n}", job) for n, job in enumerate(bad)]
    # Among each other.
    jobs.sort(key=lambda job: hash_of(job[0]))
    (folder / "jobs.toml").write_text(head + "".join(f"\n[[job]]\nname = '{name}'\n{job}\n" for name, job in jobs))
    chance = random.Random(1)
    kills, of_batch, lost, reports = 0, 0, 0, 0
    report = folder / "jobs-report.json"
    while True:
        report.unlink(missing_ok=True)
        process = start(bismar, folder, "batch jobs.toml --jobs 8 -q")
        if kills < 25:
            time.sleep(chance.uniform(0.05, 3))
            victims = [process.pid] if kills % 2 else children(process.pid)
            done = [victim for victim in victims[:1] if process.poll() is None and kill(victim)]
            kills += len(done)
            of_batch += len(done) if kills % 2 == 0 else 0
        code = process.wait()
        if code >= 0:
            entries = json.loads(report.read_text())["jobs"]
            reports += 1
            lost += sum(name not in {entry["job"] for entry in entries} for name, _ in jobs) + abs(len(entries) - 60)
            if kills >= 25:
                break
            # It had come to its end: some of it is to be done again.
            for path in chance.sample(sorted((folder / "out").glob("*.exr")), 20):
                path.unlink()
    status = {entry["job"]: entry for entry in entries}
    wrong = [name for name, _ in jobs if (status[name]["status"] in ("done", "before")) != name.startswith("good")]
    codes = sorted({status[f"bad{n}"]["exit_code"] for n in range(len(bad))})
    differ = 0
    for n in range(good):
        run(bismar, folder, f"render scene.glb --size 64x48 --spp 384 --seed {n} -o whole.exr -q")
        differ += reader.read_exr(folder / "whole.exr") != reader.read_exr(folder / f"out/good{n}.exr")
    left = [path.name for path in (folder / "out").iterdir() if path.name.endswith(".tmp")]
    return [
        (f"60 jobs, {len(bad)} hostile, `--jobs 8`, {kills} kills ({of_batch} of the batch, the others of its worker): "
         f"jobs missing in {reports} reports", 60 * reports, lost, ""),
        ("jobs with an unexpected result", 60, len(wrong),
         f"hostile ones exit with {', '.join(map(str, codes))}" + (f"; {wrong}" if wrong else "")),
        ("pictures with other bits than a single render", good, differ, ""),
        ("files left behind", good, len(left), ""),
    ]


def hash_of(text):
    return random.Random(text).random()


def paths(picture):
    """Paths that a picture says it holds; 0 if there is none."""
    try:
        # Of one pixel, and of all.
        return max(map(int, re.findall(rb'"paths":(\d+)', picture.read_bytes()[:20_000])), default=0)
    except FileNotFoundError:
        return 0


@section("Preemptions")
def preemptions(bismar, folder):
    """A farm task, preempted 20 times after some progress, then killed before any progress."""
    shutil.copy(ROOT / "scenes/cornell.glb", folder / "scene.glb")
    (folder / "bin").mkdir()
    for name, script in [("sbatch", "echo 7"), ("scontrol", "echo RequeueExit = 75")]:
        (folder / "bin" / name).write_text(f"#!/bin/sh\n{script}\n")
        (folder / "bin" / name).chmod(0o755)
    slurm = dict(PATH=f"{folder}/bin:{os.environ['PATH']}")
    submitted = run(bismar, folder, "farm submit scene.glb -- --size 64x48 --spp 1000000000 -o out.exr", **slurm)
    assert submitted.returncode == 0, submitted.stderr
    held = stuck = 0

    def session(restarts):
        return start(bismar, folder, "farm task 1 --plan scene.farm/farm.json", SLURM_ARRAY_JOB_ID="7",
                     SLURM_RESTART_COUNT=str(restarts), **slurm)

    log = folder / "scene.farm/logs/task-1.log"
    for restart in range(20):
        before, said = paths(folder / "out.exr"), log.stat().st_size if log.exists() else 0
        process = session(restart)
        while process.poll() is None and b"PROGRESS" not in (log.read_bytes() if log.exists() else b"")[said:]:
            time.sleep(0.01)
        kill(process.pid, signal.SIGTERM)
        held += process.wait() != 75
        stuck += paths(folder / "out.exr") <= before
    for _ in range(3):
        process = session(20)
        while process.poll() is None and not children(process.pid):
            time.sleep(0.001)
        kill(process.pid)
        process.wait()
    last = session(23).wait()
    return [
        ("preempted after some progress: held", 20, held, ""),
        ("preempted after some progress: nothing saved", 20, stuck, ""),
        ("killed three times in a row without progress: restarted", 1, int(last != 76), f"exits with {last}"),
    ]


@section("Kills of a render")
def kills(bismar, folder):
    """200 kills at random times of a render that saves every 20 ms. After each, a copy of the file is resumed to the end, and
    must have the bits of a render in one go; the render itself is restarted, and killed again."""
    shutil.copy(ROOT / "scenes/cornell.glb", folder / "scene.glb")
    line = "render scene.glb --size 64x48 --spp 256 -q --checkpoint 0.02 --resume -o"
    began = time.monotonic()
    run(bismar, folder, f"{line} whole.exr")
    longest = time.monotonic() - began
    whole = reader.read_exr(folder / "whole.exr")
    chance = random.Random(2)
    out, copy = folder / "killed.exr", folder / "copy.exr"
    count = differ = fell = empty = midway = most = 0
    while count < 200:
        process = start(bismar, folder, f"{line} killed.exr")
        time.sleep(chance.uniform(0, longest / 2))
        if not (process.poll() is None and kill(process.pid)):
            # It had come to its end.
            out.unlink(missing_ok=True)
            most = 0
            continue
        process.wait()
        count += 1
        held = paths(out)
        fell += held < most
        most = held
        empty += held == 0
        midway += 0 < held < 256 * 64 * 48
        copy.unlink(missing_ok=True)
        if out.exists():
            shutil.copy(out, copy)
        code = run(bismar, folder, f"{line} copy.exr").returncode
        differ += code != 0 or reader.read_exr(copy) != whole
    return [
        (f"{count} kills, each resumed to the end: other bits than in one go", count, differ,
         f"{empty} before the first save, {midway} with a part of the paths"),
        ("kills after which the file held less than before", count, fell, ""),
    ]


def write(title, text, rows):
    """Replaces a section of the page, or appends it."""
    page = PAGE.read_text() if PAGE.exists() else HEAD
    table = "| what | tries | failures | |\n| --- | --- | --- | --- |\n"
    table += "".join(f"| {what} | {tries} | {failures} | {remark} |\n" for what, tries, failures, remark in rows)
    new = f"## {title}\n{text}\n\n{table}"
    found = re.search(rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", page, re.M | re.S)
    page = page.replace(found.group(0), new + "\n") if found else page.rstrip("\n") + f"\n\n{new}"
    PAGE.write_text(page.rstrip("\n") + "\n")


def main():
    for module in (reliability_files, reliability_memory, reliability_commands):
        for title, function in module.SECTIONS.items():
            section(title)(function)
    if len(sys.argv) < 3 or not set(sys.argv[2:]) <= {"all", *SECTIONS}:
        sys.exit(f"{__doc__}\nsections: all, {', '.join(SECTIONS)}")
    bismar = str(Path(sys.argv[1]).resolve())
    version = subprocess.run([bismar, "--version"], capture_output=True, text=True, check=True).stdout.split()
    version = f"{version[3]}, {time.strftime('%B %Y')}"
    failed = False
    for name, (title, function) in SECTIONS.items():
        if not {"all", name} & set(sys.argv[2:]):
            continue
        with tempfile.TemporaryDirectory() as folder:
            rows = function(bismar, Path(folder))
        write(title, f"{' '.join(function.__doc__.split())} (`{name}`; {version})", rows)
        for row in rows:
            print(f"{name}: {row[0]}: {row[2]} of {row[1]} {row[3]}", flush=True)
            failed |= row[2] > 0
    sys.exit(failed)


if __name__ == "__main__":
    main()
