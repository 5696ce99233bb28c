"""Errors, signals, threads, memory and time."""

import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from PIL import Image

import bismar


@pytest.mark.parametrize(
    "work, kind, code",
    [
        (lambda s: bismar.load("nowhere.glb"), bismar.InputError, 66),
        (lambda s: bismar.load(__file__), bismar.InputError, 65),
        (lambda s: bismar.load("x.glb", pose=-1), bismar.UsageError, 64),
        (lambda s: bismar.load("x.glb", shutter=(1, 0), frame=3), bismar.UsageError, 64),
        (lambda s: s.render(spp=0), bismar.UsageError, 64),
        (lambda s: s.render(size=(0, 5)), bismar.UsageError, 64),
        (lambda s: s.render(size=(5,)), bismar.UsageError, 64),
        (lambda s: s.render(size=(5,), balance=lambda moments: 0.5, spp=8), bismar.UsageError, 64),
        (lambda s: s.render(crop=(0, 1)), bismar.UsageError, 64),
        (lambda s: s.render(crop=7), bismar.UsageError, 64),
        (lambda s: bismar.load("x.glb", threads=2**31), bismar.UsageError, 64),
        (lambda s: bismar.load("x.glb", threads=0), bismar.UsageError, 64),
        (lambda s: bismar.load("x.glb", threads=-1), bismar.UsageError, 64),
        (lambda s: bismar.load("x.glb", threads=2**64), bismar.UsageError, 64),
        (lambda s: bismar.look("x.glb", threads=1.5), bismar.UsageError, 64),
        (lambda s: s.render(camera="nobody"), bismar.UsageError, 64),
        (lambda s: s.render(balance="best"), bismar.UsageError, 64),
        (lambda s: s.render(aovs=["colour"]), bismar.UsageError, 64),
        (lambda s: s.render(noise=object()), bismar.UsageError, 64),
        (lambda s: s.render(size=(65536, 65536), spp=1), bismar.HostError, 76),
        (lambda s: s.render(size=(8, 8), spp=1).save("/nowhere/a.exr"), bismar.FileError, 73),
        (lambda s: s.render(size=(8, 8), spp=1).save("a.gif"), bismar.UsageError, 64),
        (lambda s: s.render(size=(8, 8), spp=1).save("a.exr", view="pretty"), bismar.UsageError, 64),
        (lambda s: bismar.compare(s.render(size=(8, 8), spp=1), s.render(size=(9, 8), spp=1)), bismar.InputError, 65),
        (lambda s: bismar.merge(["nowhere.exr"], "/tmp/merged.exr"), bismar.InputError, 66),
        (lambda s: bismar.develop("nowhere.exr"), bismar.InputError, 66),
        (lambda s: bismar._bismar._panic(), bismar.InternalError, 70),
    ],
)
def test_errors_are_exceptions_by_exit_code(cornell, work, kind, code):
    with pytest.raises(kind) as raised:
        work(cornell)
    assert isinstance(raised.value, bismar.Error) and raised.value.exit_code == code and str(raised.value)


def test_values_of_numpy_and_paths_of_bytes_are_those_of_python(scenes, tmp_path):
    (tmp_path / "\udcff.glb").write_bytes((scenes / "cornell.glb").read_bytes())
    path = os.fsencode(tmp_path / "\udcff.glb")
    scene, same = bismar.load(path), bismar.load(scenes / "cornell.glb")
    first = same.render(size=(16, 12), spp=2, orbit=(30, 20), transparent=True, adaptive=False, path_reuse=True, denoise=False)
    given = {"size": np.array([16, 12]), "spp": np.int64(2), "orbit": np.array([30.0, 20.0]), "denoise": np.bool_(False)}
    second = scene.render(**given, transparent=np.True_, adaptive=np.False_, path_reuse=np.True_)
    assert (first["beauty"] == second["beauty"]).all() and first["beauty"][..., 3].min() == 0
    # True is "on", and False "off", not what a pre-pass decides.
    for name in ["path_reuse", "guiding", "learned_lights", "compensation", "adaptive"]:
        modes = [same.render(size=(8, 8), spp=2, **{name: value}).stats["settings"] for value in (True, "on", False, "off")]
        assert modes[0] == modes[1] != modes[2] == modes[3], name
    environment = os.fsencode(tmp_path / "\udcfe.hdr")
    with open(environment, "wb") as file:
        file.write((scenes / "field.hdr").read_bytes())
    lit = bismar.load(path, env=environment, strict=np.False_, velocity=np.bool_(False)).render(size=(8, 8), spp=1)
    picture = os.fsencode(tmp_path / "a.exr")
    lit.save(picture, resumable=np.bool_(True), half=np.bool_(False))
    bismar.develop(picture, picture + b".png")
    assert bismar.compare(picture, lit)["rmse"] < 1e-6
    second.save(tmp_path / "b.exr", resumable=np.bool_(True))
    same.render(size=(16, 12), spp=2, orbit=(30, 20), aovs="object").save(picture)
    bismar.labels(picture, picture + b".json", ids=np.bool_(True))
    bismar.look(path, size=np.array([16, 16]), spp=1).save(picture + b".look.png")
    assert len(bismar.look([path] * 3, size=(16, 16), spp=1).report["scenes"]) == 3
    assert sorted(os.listdir(tmp_path))[:5] == ["a.exr", "a.exr.json", "a.exr.look.png", "a.exr.png", "a.object.png"]
    ended = same.render(size=(128, 128), spp=1_000_000, progress=lambda now: np.bool_(now.seconds < 0.1))
    assert ended.interrupted


def test_no_call_holds_the_lock_while_it_thinks(scenes):
    scene = bismar.load(scenes / "cornell.glb")
    lens = {"w": 800, "h": 600, "fl_x": 600, "fl_y": 600, "cx": 400, "cy": 300, "k1": 1e8, "k2": -1e8, "p1": 1e6, "p2": -1e6}
    longest, last, done = 0.0, time.monotonic(), threading.Event()

    def refused():
        for _ in range(20):
            with pytest.raises(bismar.UsageError):
                scene.add_camera(np.eye(4), intrinsics=lens)
        done.set()

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    thread = threading.Thread(target=refused)
    thread.start()
    while not done.is_set():
        now = time.monotonic()
        longest, last = max(longest, now - last), now
        time.sleep(0.0005)
    thread.join()
    sys.setswitchinterval(before)
    print(f"{longest:.3f} s without the lock")
    assert longest < 0.5


def test_the_denoiser_of_the_package_pyoidn_is_found(scenes, tmp_path):
    library = tmp_path / "pyoidn/oidn/lib/libOpenImageDenoise.so.2"
    library.parent.mkdir(parents=True)
    (tmp_path / "pyoidn/__init__.py").write_text("raise ImportError('it needs cffi')")
    names = ["NewDevice", "NewFilter", "SetSharedFilterImage", "SetFilterBool", "GetDeviceError", "CommitDevice", "CommitFilter",
             "ReleaseFilter", "ReleaseDevice", "ExecuteFilter"]
    code = "static int x;" + "".join(f"void *oidn{name}() {{ return {'&x' if 'New' in name else 0}; }}" for name in names)
    subprocess.run(["cc", "-shared", "-fPIC", "-w", "-x", "c", "-o", str(library), "-"], input=code, text=True, check=True)
    program = f"import bismar; p = bismar.load({str(scenes / 'cornell.glb')!r}).render(size=(8, 8), spp=1, denoise=True); print(p.denoise().sum())"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "HOME": "/nowhere", "PATH": "/nowhere/bin"}
    environment.pop("BISMAR_OIDN", None)
    said = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert said.stdout == "0.0\n", said.stderr


def test_a_scene_that_vanishes_between_renders_is_not_missed(scenes, tmp_path):
    path = tmp_path / "scene.glb"
    path.write_bytes((scenes / "cornell.glb").read_bytes())
    scene = bismar.load(path)
    first = scene.render(size=(8, 8), spp=2)["beauty"]
    path.unlink()
    assert (scene.render(size=(8, 8), spp=2)["beauty"] == first).all()
    with pytest.raises(bismar.InputError):
        scene.inspect()


def test_ctrl_c_gives_what_there_is(cornell, tmp_path):
    # What a shell starts in the background ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Later again while nothing is rendered yet.
    for delay in (0.5, 2, 8, 32):
        threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt) as raised:
            cornell.render(size=(256, 256), spp=1_000_000)
        assert isinstance(raised.value, bismar.Interrupted) and raised.value.exit_code == 75
        picture = raised.value.picture
        if picture is not None:
            break
    assert picture.interrupted and picture["beauty"].mean() > 0
    picture.save(tmp_path / "part.exr")


def test_a_callback_sees_progress_and_ends_a_render(cornell):
    seen = []

    def ends(progress):
        seen.append(progress)
        return progress.seconds < 0.3

    picture = cornell.render(size=(128, 128), spp=1_000_000, progress=ends)
    assert picture.interrupted and picture.stats["stop"] == "interrupted"
    assert all(0 <= p.fraction <= 1 for p in seen) and seen[-1].spp > 0

    def fails(progress):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        cornell.render(size=(128, 128), spp=1_000_000, progress=fails)


def test_python_runs_while_a_picture_renders(cornell):
    counted, done = 0, threading.Event()
    render = threading.Thread(target=lambda: (cornell.render(size=(64, 64), time=0.7), done.set()))
    render.start()
    while not done.is_set():
        counted += 1
        time.sleep(0.001)
    render.join()
    assert counted > 50


def test_threads_and_numbers_of_threads_make_the_same_picture(scenes, cornell):
    expected = cornell.render(size=(24, 24), spp=8)["beauty"]
    found = []
    work = [threading.Thread(target=lambda: found.append(cornell.render(size=(24, 24), spp=8))) for _ in range(4)]
    [thread.start() for thread in work]
    [thread.join() for thread in work]
    found.append(bismar.load(scenes / "cornell.glb", threads=1).render(size=(24, 24), spp=8))
    assert len(found) == 5 and all((picture["beauty"] == expected).all() for picture in found)


def test_a_fork_before_the_first_use_works_and_one_after_it_is_an_error(scenes):
    program = f"""
import os, bismar
def use():
    bismar.load({str(scenes / "cornell.glb")!r}).render(size=(8, 8), spp=1)
child = os.fork()
if child == 0:
    use(); os._exit(7)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
use()
child = os.fork()
if child == 0:
    try:
        use()
    except bismar.HostError as error:
        os._exit(error.exit_code)
    os._exit(0)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 76
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_warnings_go_to_logging(scenes, caplog):
    with caplog.at_level(logging.INFO, logger="bismar"):
        bismar.load(scenes / "cornell.glb", no_env=True)
    assert any("read " in record.message for record in caplog.records if record.name == "bismar")


def test_import_brings_numpy_and_little_else():
    program = "import sys, numpy; before = len(sys.modules); import bismar; print(len(sys.modules) - before)"
    assert int(subprocess.check_output([sys.executable, "-c", program])) < 40


def test_callables_may_render_the_scene_that_calls_them(scenes):
    scene = bismar.load(scenes / "cornell.glb", threads=1)
    inner = []

    def balance(moments):
        inner.append(scene.render(size=(8, 8), spp=1)["beauty"].mean())
        return 0.5

    scene.render(size=(8, 8), spp=16, balance=balance)
    assert inner and all(np.isfinite(inner))

    def elsewhere(moments):
        thread = threading.Thread(target=balance, args=(moments,))
        thread.start()
        thread.join()
        return 0.5

    before = len(inner)
    scene.render(size=(8, 8), spp=16, balance=elsewhere)
    assert len(inner) > before

    def progress(now):
        inner.append(scene.render(size=(8, 8), spp=1)["beauty"].mean())
        return False

    before = len(inner)
    scene.render(size=(200, 200), spp=4096, progress=progress)
    assert len(inner) > before


def test_a_picture_does_not_replace_what_it_was_made_of(scenes, tmp_path):
    (tmp_path / "s.glb").write_bytes((scenes / "cornell.glb").read_bytes())
    sky = tmp_path / "sky.hdr"
    sky.write_bytes((scenes / "field.hdr").read_bytes())
    picture = bismar.load(tmp_path / "s.glb", env=sky).render(size=(8, 8), spp=1)
    link = tmp_path / "link.exr"
    link.symlink_to(sky)
    with pytest.raises(bismar.UsageError, match="would overwrite"):
        picture.save(link)
    assert sky.read_bytes() == (scenes / "field.hdr").read_bytes()


def test_no_picture_replaces_a_scene_s_files_wherever_the_program_has_gone(scenes, tmp_path, monkeypatch):
    (tmp_path / "s.glb").write_bytes((scenes / "cornell.glb").read_bytes())
    Image.new("RGB", (2, 2)).save(tmp_path / "t.png")
    buffer = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes() + np.zeros((3, 2), np.float32).tobytes()
    (tmp_path / "b.bin").write_bytes(buffer)
    views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
        {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
    ]
    scene = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "b.bin", "byteLength": len(buffer)}],
        "bufferViews": views,
        "accessors": accessors,
        "images": [{"uri": "t.png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    (tmp_path / "t.gltf").write_text(json.dumps(scene))
    (tmp_path / "below").mkdir()
    for name in ["t.gltf", "b.bin"]:
        (tmp_path / f"{name}.png").symlink_to(name)
    monkeypatch.chdir(tmp_path)
    results = [bismar.load("t.gltf", sky=True).render(size=(8, 8), spp=1), bismar.look("t.gltf", size=(32, 32), spp=1)]
    for folder in ["", "below"]:
        monkeypatch.chdir(tmp_path / folder)
        for result in results:
            for name in ["t.png", "t.gltf.png", "b.bin.png"]:
                with pytest.raises(bismar.UsageError, match="would overwrite"):
                    result.save(tmp_path / name)
    assert (tmp_path / "b.bin").read_bytes() == buffer


def test_outputs_that_nobody_has_named_replace_nothing_of_others(cornell, tmp_path):
    cornell.render(size=(8, 8), spp=1, aovs=["object", "depth"]).save(tmp_path / "p.exr")
    calls = {
        "p.object.png": lambda: bismar.labels([tmp_path / "p.exr"], ids=True),
        "p.depth.npy": lambda: bismar.labels([tmp_path / "p.exr"], depth=["npy"]),
        "p.png": lambda: bismar.develop(tmp_path / "p.exr"),
    }
    mine = tmp_path / "mine"
    for name, call in calls.items():
        output = tmp_path / name
        mine.write_bytes(b"mine")
        for make in [lambda: output.write_bytes(b"mine"), lambda: output.symlink_to("mine"), lambda: os.mkfifo(output)]:
            make()
            with pytest.raises(bismar.FileError):
                call()
            assert mine.read_bytes() == b"mine"
            output.unlink()
        call()
        call()
    # What is named is replaced.
    (tmp_path / "named.png").symlink_to("mine")
    bismar.develop(tmp_path / "p.exr", tmp_path / "named.png")
    assert mine.read_bytes() != b"mine"


def resident():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS:"))


def test_a_thousand_renders_keep_memory_flat(cornell, tmp_path):
    def once(seed):
        picture = cornell.render(size=(16, 16), spp=1, seed=seed, aovs=["depth", "object"])
        assert picture["depth"].shape == (16, 16, 1) and np.isfinite(picture["beauty"]).all()
        if seed % 20 == 0:
            picture.save(tmp_path / "a.exr")

    [once(seed) for seed in range(200)]
    before = resident()
    [once(seed) for seed in range(1000)]
    grown = resident() - before
    print(f"{before:.1f} MiB, grown by {grown:.2f} MiB")
    # A picture has 16 x 16 pixels of about 200 bytes: one leaked array a render would be over 50 MiB.
    assert grown < 4
