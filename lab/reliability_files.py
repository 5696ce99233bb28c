"""Sections of `reliability.py` that misname, change, starve and mutate what bismar is given."""

import concurrent.futures
import itertools
import json
import os
import random
import re
import resource
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def environment(threads, **more):
    """The environment of bismar, outside of any Slurm task."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SLURM_")}
    return {**kept, "BISMAR_THREADS": str(threads), **more}


def run(bismar, folder, line, before=None):
    words = line.split() if isinstance(line, str) else line
    return subprocess.run([bismar, *words], cwd=folder, env=environment(1), capture_output=True, text=True,
                          errors="replace", preexec_fn=before)


def on_all_cores(work, items):
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(work, items))


def flips(bismar, folder):
    """Finished pictures with one bit flipped, or truncated; then the same command with `--resume`."""
    shutil.copy(ROOT / "scenes/cornell.glb", folder / "cornell.glb")
    line = "render {}/cornell.glb --size 40x24 --spp 8 -q --resume -o out.exr"
    whole = {}
    for more in ["", " --checkpoint 9", " --aov all"]:
        assert run(bismar, folder, line.format(folder) + more).returncode == 0
        whole[more] = (folder / "out.exr").read_bytes()
        (folder / "out.exr").unlink()

    def attempt(number):
        chance = random.Random(number)
        more = chance.choice(list(whole))
        content = bytearray(whole[more])
        cut = number % 10 == 0
        if cut:
            del content[chance.randrange(len(content)):]
        else:
            content[chance.randrange(len(content) if number % 2 else min(8192, len(content)))] ^= 1 << chance.randrange(8)
        own = folder / f"try{number}"
        own.mkdir()
        (own / "out.exr").write_bytes(content)
        code = run(bismar, own, line.format(folder) + more).returncode
        done = code == 0 and (own / "out.exr").read_bytes() == content
        shutil.rmtree(own)
        return cut, done, code

    found = on_all_cores(attempt, range(10_000))
    rows = []
    for name, cut in [("one bit flipped", False), ("truncated", True)]:
        codes = [code for c, _, code in found if c == cut]
        shown = ", ".join(f"{codes.count(code)} exit with {code}" for code in sorted(set(codes)))
        rows.append((f"{name}: treated as finished", len(codes), sum(done for c, done, _ in found if c == cut), shown))
    rows.append(("any other exit code than 0, 65 and 66", len(found), sum(code not in (0, 65, 66) for *_, code in found), ""))
    return rows


# Each command's path flags: what stands before the path, whether it is written, and how it must end.
COMMANDS = {
    "render --size 40x24 --spp 1 -q": [
        ("", "cornell.glb", None), ("--env", "sky.exr", None), ("--path-mapping", "rules.json", None),
        ("-o", None, "exr"), ("--preview", None, "png"), ("--stats", None, "json")],
    "merge -q": [
        ("", "1.exr", None), ("", "2.exr", None), ("--path-mapping", "rules.json", None),
        ("-o", None, "exr"), ("--preview", None, "png")],
    "compare": [("", "sky.exr", None), ("", "1.exr", None), ("--diff", None, "exr")],
    "develop -q": [("", "sky.exr", None), ("-o", None, "png")],
    "batch -q": [("", "jobs.toml", None), ("--report", None, "json"), ("--events", None, "json")],
}


def spellings(folder, file):
    """Five names of a file that is there or not."""
    stem, extension = file.split(".")
    link = f"link-{stem}.{extension}"
    (folder / link).unlink(missing_ok=True)
    (folder / link).symlink_to(file)
    names = [file, f"./{file}", f"sub/../here/{file}", str(folder / file), link]
    if (folder / file).exists():
        hard = f"hard-{stem}.{extension}"
        (folder / hard).unlink(missing_ok=True)
        os.link(folder / file, folder / hard)
        names.append(hard)
    return names


def names(bismar, folder):
    """Every pair of path flags of a command, of which at least one is an output, given the same file under each of its names
    (links, other spellings)."""
    shutil.copy(ROOT / "scenes/cornell.glb", folder)
    (folder / "sub").mkdir()
    (folder / "here").symlink_to(".")
    render = "render cornell.glb --size 40x24 --spp 1 -q --checkpoint 9"
    for more in ["-o sky.exr", "-o 1.exr --part 1/2", "-o 2.exr --part 2/2"]:
        assert run(bismar, folder, f"{render} {more}").returncode == 0
    (folder / "rules.json").write_text('{"version":"pathmapping-1.0","path_mapping_rules":[]}')
    (folder / "jobs.toml").write_text("[[job]]\nscene = 'cornell.glb'\nsize = '40x24'\nspp = 1\n")
    tries = lost = done = pairs = 0
    for command, flags in COMMANDS.items():
        for (i, (_, first, first_end)), (j, (_, second, end)) in itertools.permutations(enumerate(flags), 2):
            if second is not None or (first is None and j < i):
                continue
            pairs += 1
            # A copy of the input that is named as the output must be.
            shared = f"shared.{end if first else first_end}"
            if first is None and first_end != end and "json" not in (first_end, end):
                # Only a link can have both.
                shared = f"shared.{first_end}"
            (folder / shared).unlink(missing_ok=True)
            if first:
                shutil.copy(folder / first, folder / shared)
            for name in spellings(folder, shared):
                if not name.endswith(end) and end != "json":
                    link = f"other.{end}"
                    (folder / link).unlink(missing_ok=True)
                    (folder / link).symlink_to(name)
                    name = link
                words = command.split()
                for k, (flag, file, file_end) in enumerate(flags):
                    path = {i: shared, j: name}.get(k, file or (f"fresh{k}.{file_end}" if flag == "-o" else None))
                    words += [word for word in (flag, path) if word] if path else []
                before = (folder / shared).read_bytes() if first else None
                code = run(bismar, folder, words).returncode
                tries += 1
                done += code != 64
                lost += first is not None and (folder / shared).read_bytes() != before
                for path in [*folder.glob("fresh*"), *([] if first else [folder / shared])]:
                    path.unlink(missing_ok=True)
    return [(f"{pairs} pairs of flags under five or six names: an input was lost", tries, lost, ""),
            ("anything but refused with exit code 64", tries, done, "")]


def memory(bismar, folder):
    """Renders with less memory than they need, a little more, or much more: limited by a memory cgroup (version 1, where the
    machine permits), by `ulimit -v` and `ulimit -d`, by `--memory-limit`. They must end with 76, before or while rendering, or fit."""
    shutil.copy(ROOT / "scenes/cornell.glb", folder)
    shutil.copy(ROOT / "scenes/field.glb", folder)
    group = Path(f"/sys/fs/cgroup/memory/bismar-{os.getpid()}")
    ways = ["address space", "data", "flag"]
    try:
        group.mkdir()
        ways.append("cgroup")
    except OSError:
        pass
    found = {way: [] for way in ways}
    chance = random.Random(3)
    for number in range(100):
        way = ways[number % len(ways)]
        limit = int(2 ** chance.uniform(25, 29.5))
        side = chance.choice([60, 300, 500, 800])
        scene, rays = chance.choice(["cornell.glb", "field.glb"]), chance.choice(["embree", "obvhs"])
        line = f"render {scene} --size {side}x{side} --spp 1 --rays {rays} --threads " \
               f"{chance.choice([1, 2, 8])} -q -o out.exr" + chance.choice(["", " --aov all", " --checkpoint 0.1"])
        before = None
        if way == "flag":
            line += f" --memory-limit {limit}"
        elif way == "cgroup":
            (group / "memory.limit_in_bytes").write_text(str(limit))
            before = lambda: (group / "cgroup.procs").write_text("0")
        else:
            kind = resource.RLIMIT_AS if way == "address space" else resource.RLIMIT_DATA
            # In less than 64 MiB the system cannot even load the program.
            limit = limit * 4 if way == "address space" else limit
            before = lambda: resource.setrlimit(kind, (limit, limit))
        try:
            code = run(bismar, folder, line, before).returncode
        except subprocess.SubprocessError:
            continue
        found[way].append((code, f"{line}, {limit >> 20} MiB"))
    if group.exists():
        group.rmdir()
    rows = []
    for way, ends in found.items():
        wrong = [(code, line) for code, line in ends if code not in (0, 76)]
        fit = sum(code == 0 for code, _ in ends)
        remark = f"{fit} fit, {len(ends) - fit - len(wrong)} exit with 76"
        rows.append((f"limited by {way}: any other end", len(ends), len(wrong), remark + (f"; {wrong}" if wrong else "")))
    return rows


def mutations(_, folder):
    """Mutated glTF, GLB, PNG, JPEG, HDR, EXR, checkpoints, batch files and plans, through the entry points of
    `fuzz/doors.rs`, by `tests/mutations.rs`, in processes limited to 256 MiB plus four times the largest valid file. A process
    that dies or hangs for a minute is one failure, and another continues after that file."""
    test = "mutations::no_mutated_file_panics_aborts_or_hangs"
    built = subprocess.run(["cargo", "test", "--test", "all", "--no-run"], cwd=ROOT, capture_output=True, text=True)
    binaries = [ROOT / name for name in re.findall(r"\((\S*/all-\w+)\)", built.stderr)]
    lists = lambda binary: test in subprocess.run([binary, "--list"], capture_output=True, text=True).stdout
    binary = next(filter(lists, binaries))
    many = int(os.environ.get("BISMAR_MUTATIONS", 1_000_000))
    size = min(many, 20_000)

    def process(start, end):
        """What it said, if it came to its end; else how it ended, and the number in hand."""
        at = folder / f"at-{start}"
        more = {"BISMAR_MUTATIONS": str(end - start), "BISMAR_MUTATIONS_FROM": str(start), "BISMAR_MUTATIONS_AT": str(at)}
        with open(folder / f"said-{start}", "w+b") as said:
            child = subprocess.Popen([binary, "--exact", test, "--nocapture"], cwd=ROOT, env={**os.environ, **more},
                                     stdout=said, stderr=subprocess.STDOUT)
            number, why = None, ""
            while not why and child.poll() is None:
                try:
                    child.wait(60)
                except subprocess.TimeoutExpired:
                    before, number = number, at.read_bytes() if at.exists() else None
                    why = "stands still" if before == number else ""
            if why:
                child.kill()
            code = child.wait()
            said.seek(0)
            result = re.search(rb"^mutations: (.*)$", said.read(), re.M)
        if result:
            return json.loads(result.group(1)), code, None
        return None, why or f"ends with {code}", int.from_bytes(at.read_bytes(), "little") if at.exists() else start

    def slice_from(start):
        found, deaths, beyond, end = [], [], 0, min(start + size, many)
        while start < end:
            result, code, number = process(start, end)
            if result:
                found.append(result)
                beyond += code != 0 and not result["panics"]
                break
            deaths.append(f"{number} {code}")
            start = number + 1
        return found, deaths, beyond

    slices = on_all_cores(slice_from, range(0, many, size))
    ends = [result for found, _, _ in slices for result in found]
    rows = []
    for door in ends[0]["doors"]:
        tried, taken = (sum(end["doors"][door][i] for end in ends) for i in range(2))
        doors = list(ends[0]["doors"])
        panics = [n for end in ends for n in end["panics"] if doors[n % len(doors)] == door]
        deaths = [text for _, deaths, _ in slices for text in deaths if doors[int(text.split()[0]) % len(doors)] == door]
        rows.append((f"{door}: panics, aborts, hangs", tried + len(deaths), len(panics) + len(deaths),
                     f"{taken} accepted, the others refused" + "".join(f"; {n}" for n in [*panics, *deaths][:5])))
    rows.append(("processes beyond their memory", len(ends), sum(beyond for *_, beyond in slices),
                 f"at most {max(end['peak'] for end in ends) >> 20} MiB; the slowest file took "
                 f"{max(end['slowest'] for end in ends):.2f} s"))
    return rows


SECTIONS = {"Changed and cut pictures": flips, "One file by many names": names, "Little memory": memory,
            "Mutated files": mutations}
