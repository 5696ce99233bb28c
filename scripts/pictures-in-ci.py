#!/usr/bin/env python3
"""Pictures of a change, in continuous integration: golden pictures, or scenes before and after (docs/ci.md).

    pictures-in-ci.py goldens PATH...               `bismar check` of golden pictures
    pictures-in-ci.py pairs --base REVISION PATH... `bismar look` of folders of scenes: at the revision, and as they are

Writes pictures and summary.md, and of goldens a page, to --out; appends the summary to $GITHUB_STEP_SUMMARY if that is set. The exit code is that
of bismar: 1 for pictures that differ by more than --max-flip. Needs Python 3.9 and, for pairs, git.
"""

import argparse
import json
import os
import shlex
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path


def bismar(options, *arguments):
    """Runs the program; returns its exit code and what it has printed."""
    ran = subprocess.run([*shlex.split(options.bismar), *map(str, arguments)], stdout=subprocess.PIPE, text=True)
    return ran.returncode, ran.stdout


def cell(text):
    """Text in a cell of a table."""
    return " ".join(str(text).split()).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("`", "\\`")


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(map(cell, line)) + " |\n" for line in lines)


def goldens(options):
    limit = [] if options.max_flip is None else ["--max-flip", options.max_flip]
    code, _ = bismar(options, "check", *limit, "--out", options.out, *options.paths)
    report = options.out / "report.json"
    if not report.exists():
        return code, "No golden picture was checked: see the log.\n"
    checks = json.loads(report.read_text())["goldens"]
    rows = [(one["golden"], one["outcome"], one.get("error") or "") for one in checks if one["outcome"] != "identical"]
    text = f"{len(checks)} golden pictures, {len(checks) - len(rows)} of them identical.\n"
    return code, text + ("\n" + table(["golden picture", "outcome", "why"], rows) if rows else "")


def extract(base, path, folder):
    """Writes the files below `path` at a revision to `folder`; none if it was not there."""
    folder.mkdir(parents=True)
    here = subprocess.run(["git", "rev-parse", "--show-prefix"], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
    if subprocess.run(["git", "cat-file", "-e", f"{base}:{here}{path}"], stderr=subprocess.DEVNULL).returncode != 0:
        return
    archive = ["git", "archive", "--format=tar", f"{base}:{here}{path}"]
    with subprocess.Popen(archive, stdout=subprocess.PIPE) as ran, tarfile.open(fileobj=ran.stdout, mode="r|") as tar:
        for member in tar:
            # Links lead to files of other revisions, or outside.
            if member.isfile() or member.isdir():
                tar.extract(member, folder)


def pairs(options):
    known = ["git", "rev-parse", "--verify", "--quiet", f"{options.base}^{{commit}}"]
    if subprocess.run(known, stdout=subprocess.DEVNULL).returncode != 0:
        return 66, f"The revision {options.base} is not here: fetch it.\n"
    worst, text = 0, ""
    limit = [] if options.max_flip is None else ["--max-flip", options.max_flip]
    for number, path in enumerate(options.paths, 1):
        name = f"pairs-{number}" if len(options.paths) > 1 else "pairs"
        with tempfile.TemporaryDirectory() as folder:
            old = Path(folder) / "base"
            extract(options.base, Path(path).as_posix(), old)
            code, printed = bismar(options, "look", *limit, "-o", options.out / f"{name}.png", "--", old, path)
        worst = max(worst, code)
        if not printed.strip():
            text += f"`{path}`: exit code {code}, see the log.\n"
            continue
        found = json.loads(printed)
        counts = [f"{len(found[kind])} {kind}" for kind in ["added", "removed", "changed", "unchanged", "failed"]]
        text += f"`{path}`: {', '.join(counts)}.\n"
        rows = [(one["name"], f"{one['flip']:.4f}", "; ".join(one["differences"])) for one in found["changed"]]
        rows += [(name, "", kind) for kind in ["added", "removed"] for name in found[kind]]
        rows += [(one.get("name", ""), "", one.get("error", "failed")) for one in found["failed"]]
        text += "\n" + table(["scene", "FLIP", "what differs"], rows) if rows else ""
    return worst, text


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
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
    code, text = {"goldens": goldens, "pairs": pairs}[options.mode](options)
    text = f"## Bismar: {options.mode}\n\n{text}"
    (options.out / "summary.md").write_text(text)
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        with open(summary, "a", encoding="utf-8") as file:
            file.write(text)
    print(text)
    return code


if __name__ == "__main__":
    sys.exit(main())
