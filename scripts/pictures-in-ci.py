#!/usr/bin/env python3
"""Pictures of a change, in continuous integration: golden pictures, or scenes before and after (docs/ci.md).

    pictures-in-ci.py goldens PATH...               `bismar check` of golden pictures
    pictures-in-ci.py pairs --base REVISION PATH... `bismar look` of folders of scenes: at the revision, and as they are

Writes pictures and summary.md, and of goldens a page, to --out; appends the summary to $GITHUB_STEP_SUMMARY if that is set. The exit code is that
of bismar: 1 for pictures that differ by more than --max-flip, 65 for what cannot be compared. Needs Python 3.9 and, for pairs, git.
"""

import argparse
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
import unicodedata
from pathlib import Path


def plain(text):
    """Text of files as text: without what a terminal or a runner (`##[command]`, `::command::`) obeys, or what reverses its order."""
    hidden = lambda c: c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    text = "".join(f"\\u{{{ord(c):x}}}" if hidden(c) else c for c in str(text))
    return re.sub(r"^(\s*):(?=:)", r"\1\\u{3a}", text.replace("##[", "#\\u{23}["), flags=re.M)


def bismar(options, *arguments):
    """Runs the program; returns its exit code and what it has printed."""
    command = [*shlex.split(options.bismar), *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "encoding": "utf-8", "errors": "backslashreplace"}
    with subprocess.Popen(command, **pipes) as ran:
        log = threading.Thread(target=lambda: [print(plain(line), end="", file=sys.stderr, flush=True) for line in ran.stderr])
        log.start()
        printed = ran.stdout.read()
        log.join()
    return ran.returncode if ran.returncode >= 0 else 128 - ran.returncode, printed


def git(*arguments):
    """Runs git; returns its exit code and what it has printed, or its error."""
    ran = subprocess.run(["git", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", errors="surrogateescape")
    return ran.returncode, ran.stdout if ran.returncode == 0 else ran.stderr.strip()


def cell(text):
    """Text in a cell of a table."""
    text = re.sub(r"([\\`*_{}\[\]()<#+!|~@&$^]|:(?=\S)|(?<!-)>|(?<=www)\.)", r"\\\1", " ".join(str(text).split()))
    return plain(text)


def code(text):
    """Text as code."""
    text = plain(" ".join(str(text).split()))
    fence = "`" * (max(map(len, re.findall("`+", text)), default=0) + 1)
    return f"{fence} {text} {fence}" if len(fence) > 1 else f"`{text}`"


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(map(cell, line)) + " |\n" for line in lines)


def goldens(options):
    limit = [] if options.max_flip is None else ["--max-flip", options.max_flip]
    exit_code, _ = bismar(options, "check", *limit, "--out", options.out, "--", *options.paths)
    report = options.out / "report.json"
    if not report.exists():
        return exit_code, "No golden picture was checked: see the log.\n"
    checks = json.loads(report.read_text(encoding="utf-8"))["goldens"]
    rows = [(one["golden"], one["outcome"], one.get("error") or "") for one in checks if one["outcome"] != "identical"]
    text = f"{len(checks)} golden pictures, {len(checks) - len(rows)} of them identical.\n"
    return exit_code, text + ("\n" + table(["golden picture", "outcome", "why"], rows) if rows else "")


class Refused(Exception):
    """A path that cannot be compared: exit code and why."""


def is_below(path, folder):
    return os.path.commonpath([os.path.realpath(path), folder]) == folder


def links(side, checkout):
    """The links to folders below a folder, relative to it. Refuses links that leave the checkout: both sides would read the same."""
    found = []
    for folder, folders, files in os.walk(side):
        folders[:] = [name for name in folders if name != ".git"]
        for path in (os.path.join(folder, name) for name in folders + files):
            if os.path.islink(path) and not is_below(path, checkout):
                raise Refused(65, f"{os.path.relpath(path, checkout)} is a link that leads out of the repository: not compared")
        found += [os.path.relpath(os.path.join(folder, name), side) for name in folders if os.path.islink(os.path.join(folder, name))]
    return found


def check_out(base, path, there, here):
    """Refuses a path of which git has not checked out all, at the base or here."""
    for side, printed in [(there, git("ls-tree", "-r", "-z", "--full-tree", base)[1]), (None, git("-C", here, "ls-files", "-s", "-z")[1])]:
        for mode, name in ((line.split(" ")[0], line.split("\t", 1)[1]) for line in printed.split("\0")[:-1]):
            within = path == "." or f"{name}/".startswith(f"{path}/")
            if mode == "160000" and (within or f"{path}/".startswith(f"{name}/")):
                raise Refused(65, f"{name} is a submodule: not compared")
            if side and within and not os.path.lexists(os.path.join(side, name)):
                raise Refused(65, f"{name} is not checked out at the base: not compared")
    for line in git("--literal-pathspecs", "ls-files", "-z", "-t", "--", os.path.join(here, path))[1].split("\0"):
        if line.startswith("S "):
            raise Refused(65, f"{line[2:]} is left out by a sparse checkout: not compared")


def compared(options, old, new, path, sheet, limit):
    """Compares a scene or a folder of scenes; what bismar says of folders, or the exit code alone."""
    sides = [old if os.path.lexists(old) else None, new if os.path.lexists(new) else None]
    kinds = {os.path.isdir(side) for side in sides if side}
    if not kinds:
        raise Refused(66, "neither here nor at the base")
    if len(kinds) > 1:
        raise Refused(65, "a scene on one side and a folder on the other: not compared")
    found = {kind: [] for kind in ["added", "removed", "changed", "unchanged", "failed"]}
    if True in kinds:
        with tempfile.TemporaryDirectory() as empty:
            exit_code, printed = bismar(options, "look", *limit, "-o", sheet, "--", *(side or empty for side in sides))
        return exit_code, json.loads(printed) if printed.strip() else None
    exit_code, printed = bismar(options, "look", *(limit if all(sides) else []), "-o", sheet, "--", *filter(None, sides))
    if not printed.strip():
        return exit_code, None
    one = {**json.loads(printed), "name": path}
    kind = "added" if not sides[0] else "removed" if not sides[1] else "unchanged" if one["same_files"] else "changed"
    found[kind].append(one if kind == "changed" else path)
    if not all(one[side].get("whole", True) for side in ["old", "new", "scene"] if side in one):
        found["left_out"], exit_code = [{"name": path, "why": "files that it names, which could not be read"}], 65
    return exit_code, found


def pairs(options):
    known, base = git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{options.base}^{{commit}}")
    if known != 0:
        return 66, f"The revision {code(options.base)} is not here: fetch it.\n"
    base, here = base.strip(), os.path.realpath(git("rev-parse", "--show-toplevel")[1].rstrip("\n"))
    with tempfile.TemporaryDirectory() as folder:
        there = os.path.join(os.path.realpath(folder), "base")
        failed, why = git("worktree", "add", "--quiet", "--detach", there, base)
        try:
            return (74, f"{code(options.base)} cannot be checked out: {cell(why)}\n") if failed else look(options, base, here, there)
        finally:
            git("worktree", "remove", "--force", there)


def look(options, base, here, there):
    worst, text, seen = 0, "", set()
    limit = [] if options.max_flip is None else ["--max-flip", options.max_flip]
    waiting, links_out = [], "a link to a folder elsewhere"
    for path in options.paths:
        full = os.path.join(os.getcwd(), path)
        inside = os.path.commonpath([full, here]) == here
        waiting.append((path, os.path.relpath(full if inside else os.path.realpath(full), here)))
    for number, (path, place) in enumerate(waiting, 1):
        name = f"pairs-{number}" if len(waiting) > 1 else "pairs"
        old, new = os.path.join(there, place), os.path.join(here, place)
        try:
            if place.split(os.sep)[0] == "..":
                raise Refused(64, "outside of the repository")
            for side, checkout in [(old, there), (new, here)]:
                if not is_below(side, checkout):
                    raise Refused(65, "a link that leads out of the repository: not compared")
            check_out(base, place, there, here)
            # Links to folders are not followed in folders: they are paths of their own.
            for link in sorted({*links(old, there), *links(new, here)}):
                ends = [(os.path.join(side, link), top) for side, top in [(old, there), (new, here)]]
                ends = tuple(os.path.lexists(end) and os.path.relpath(os.path.realpath(end), top) for end, top in ends)
                if ends not in seen and not (ends[0] == ends[1] and is_below(os.path.join(new, link), os.path.realpath(new))):
                    seen.add(ends)
                    waiting.append((os.path.join(path, link), os.path.join(place, link)))
            exit_code, found = compared(options, old, new, path, options.out / f"{name}.png", limit)
            left_out = {one["why"] for one in (found or {}).get("left_out", [])}
            if exit_code == 65 and left_out == {links_out} and not found["failed"]:
                # These are among the paths.
                exit_code = int(not all(one["within"] for one in found["changed"]))
        except Refused as refused:
            exit_code, why = refused.args
            worst, text = max(worst, exit_code), text + f"{code(path)}: {cell(why)}.\n"
            continue
        worst = max(worst, exit_code)
        if found is None:
            text += f"{code(path)}: exit code {exit_code}, see the log.\n"
            continue
        counts = [f"{len(found[kind])} {kind}" for kind in ["added", "removed", "changed", "unchanged", "failed"]]
        text += f"{code(path)}: {', '.join(counts)}.\n"
        flip = lambda one: "" if one["flip"] is None else f"{one['flip']:.4f}"
        rows = [(one["name"], flip(one), "; ".join(one["differences"])) for one in found["changed"]]
        rows += [(name, "", kind) for kind in ["added", "removed"] for name in found[kind]]
        rows += [(one.get("name", ""), "", one.get("error", "failed")) for one in found["failed"]]
        rows += [(one["name"], "", f"left out: {one['why']}") for one in found.get("left_out", []) if one["why"] != links_out]
        text += "\n" + table(["scene", "FLIP", "what differs"], rows) + "\n" if rows else ""
    return worst, text


class Parser(argparse.ArgumentParser):
    def error(self, message):
        self.print_usage(sys.stderr)
        self.exit(64, f"error: {message}\n")


def main():
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mode", choices=["goldens", "pairs"])
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--base", help="revision to compare with, for pairs")
    parser.add_argument("--max-flip", help="largest FLIP error that passes")
    parser.add_argument("--out", type=Path, default=Path("bismar-ci"), help="folder of results, new or empty [default: bismar-ci]")
    parser.add_argument("--bismar", default="bismar", help="command that starts the program [default: bismar]")
    options = parser.parse_args()
    if options.mode == "pairs" and not options.base:
        parser.error("pairs need --base")
    if options.out.exists() and any(options.out.iterdir()):
        parser.error(f"{options.out}: not empty")
    options.out.mkdir(parents=True, exist_ok=True)
    exit_code, text = {"goldens": goldens, "pairs": pairs}[options.mode](options)
    text = f"## Bismar: {options.mode}\n\n{text}"
    (options.out / "summary.md").write_text(text, encoding="utf-8")
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        with open(summary, "a", encoding="utf-8") as file:
            file.write(text)
    print(text)
    return exit_code


if __name__ == "__main__":
    # Checkouts and folders are removed then too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    try:
        sys.exit(main())
    except Exception:
        # 1 would mean that pictures differ.
        print(plain(traceback.format_exc()), file=sys.stderr)
        sys.exit(70)
