#!/usr/bin/env python3
"""Remakes the tables of the documentation whose commands take minutes, and names the numbers that differ.

    tables.py --check [NAME...]    lists differences beyond noise; exit code 1 if there are any
    tables.py --write [NAME...]    replaces the tables in the pages

Names: first-look (docs/noise.md), noise-goal (docs/noise.md), stability (docs/stability.md); all by default. What a
command wrote is kept in out/tables; --reuse compares that instead of running the command again.

A number with a standard error (a ± b) differs if it is more than three combined errors away. Seconds are of a machine and
differ beyond a fifth. z-scores are noise: only their marks count. All other numbers have fixed seeds and must be equal as
printed. Tables of lab/peers.md are made by `make bench-peers` and `make agreement`; the tables of docs/balance.md,
docs/adaptive.md and docs/guiding.md take hours and name their commands.
"""

import argparse
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "out/tables"
NOISE_GOAL_SCENES = ["cornell", "veach", "showpiece", "study/window", "many-lights", "glossy-sun", "study/mirrors"]


def first_look(bismar):
    """The script's table: estimated over true noise."""
    made = subprocess.run([ROOT / "scripts/first-look.sh"], env={**os.environ, "BISMAR": str(bismar)}, check=True,
                          capture_output=True, text=True)
    noise = "| scene | `--balance` | lowest | median | highest |\n| --- | --- | --- | --- | --- |\n" + made.stderr
    return {"docs/noise.md": noise}


def noise_goal(bismar):
    """Renders of 256 paths, and again with --noise at the error of their noisiest tile."""
    lines = ["| scene | noisiest tile at 256 | noisiest tile with `--noise` at that | mean paths a pixel | "
             "CPU seconds over those of 256 |", "| --- | --- | --- | --- | --- |"]
    with tempfile.TemporaryDirectory() as folder:
        def render(scene, *goal):
            path = ROOT / f"scenes/{scene}.glb"
            sky = path.with_suffix(".hdr")
            env = ["--env", sky] if sky.exists() else []
            stats = Path(folder) / "stats.json"
            before = os.times().children_user
            subprocess.run([bismar, "-q", "render", path, *env, "--size", "192x128", *goal, "-o", f"{folder}/a.exr", "--stats",
                            stats], check=True)
            return json.loads(stats.read_text()), os.times().children_user - before
        for scene in NOISE_GOAL_SCENES:
            fixed, seconds = render(scene, "--spp", "256")
            worst = fixed["noise_worst_tile"]
            goal, goal_seconds = render(scene, "--noise", str(worst))
            lines.append(f"| {Path(scene).name} | {worst:.3f} | {goal['noise_worst_tile']:.3f} | {goal['samples']['pixel_mean']:.0f} | "
                         f"{goal_seconds / seconds:.2f} |")
    return {"docs/noise.md": "\n".join(lines) + "\n"}


def stability(bismar):
    """The whole page."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([bismar, "-q", "study", "stability", "--out", folder], check=True, stdout=subprocess.DEVNULL)
        page = subprocess.run([ROOT / "scripts/stability-page.sh", Path(folder) / "stability.md"], check=True, capture_output=True,
                              text=True)
        return {"docs/stability.md": page.stdout}


COMMANDS = {"first-look": first_look, "noise-goal": noise_goal, "stability": stability}


def tables(text):
    """The Markdown tables of a text: (heading above, head, rows by the cells that name them, their lines)."""
    found, heading, lines = [], "", text.split("\n")
    start = None
    for i, line in enumerate([*lines, ""]):
        if line.startswith("#"):
            heading = line.lstrip("# ")
        if line.startswith("|"):
            start = i if start is None else start
        elif start is not None:
            rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in lines[start:i]]
            found.append((heading, rows[0], rows[2:], (start, i)))
            start = None
    return found


def keys(head, rows):
    """Rows by their name; `scene` and `--balance` name one together. A name that comes twice has a number."""
    named, width = {}, 2 if head[1:2] == ["`--balance`"] else 1
    for row in rows:
        name = base = " ".join(row[:width]).replace("`", "")
        number = 1
        while name in named:
            number += 1
            name = f"{base} ({number})"
        named[name] = dict(zip(head[width:], row[width:]))
    return named


def number(cell):
    """Value and standard error of a cell; None if it is none."""
    found = re.match(r"([−+-]?\d[\d.,e−-]*)(?: ± (\d[\d.e−-]*))?", cell)
    if not found:
        return None
    value, error = [float(x.replace("−", "-").replace(",", "").rstrip("-")) if x else 0.0 for x in found.groups()]
    return value, error


def differs(heading, column, old, new):
    """Is a cell's difference more than noise?"""
    if old == new:
        return False
    marks = [[mark for mark in "✗?" if mark in cell] + re.findall(r"wrong|yes|NO", cell) for cell in (old, new)]
    a, b = number(old), number(new)
    if marks[0] != marks[1] or a is None or b is None:
        return True
    if "seconds" in column:
        return abs(math.log(max(b[0], 1e-9) / max(a[0], 1e-9))) > math.log(1.2)
    if heading.lower().endswith("means") or column == "largest z":
        return False
    # What follows a share is its standard deviation over replicas, not the error of the mean.
    error = 0 if heading == "Shares" else math.hypot(a[1], b[1])
    return abs(a[0] - b[0]) > 3 * error + 1e-12


def compare(page, old, new):
    """Lines that say what differs, and the page with the new tables."""
    messages, lines, shift = [], old.split("\n"), 0
    there = tables(old)
    for heading, head, rows, _ in tables(new):
        alike = [t for t in there if t[1] == head and (t[0] == heading or not heading)]
        if not alike:
            messages.append(f"{page}: no table '{heading}' with the columns {' | '.join(head)}")
            continue
        old_heading, _, old_rows, (start, end) = alike[0]
        there.remove(alike[0])
        before, after = keys(head, old_rows), keys(head, rows)
        for name in [*before, *(n for n in after if n not in before)]:
            if name not in after or (name not in before and heading):
                messages.append(f"{page}, {old_heading}: {name}: only in the {'page' if name in before else 'new table'}")
            elif name in before:
                messages += [f"{page}, {old_heading}: {name}, {column}: {cell} is now {after[name][column]}"
                             for column, cell in before[name].items()
                             if differs(old_heading, column, cell, after[name][column])]
        # A page may show some of a command's rows.
        width = len(head) - len(next(iter(after.values())))
        kept = [row for row in rows if heading or " ".join(row[:width]).replace("`", "") in before]
        made = lines[start + shift:start + shift + 2] + ["| " + " | ".join(row) + " |" for row in kept]
        lines[start + shift:end + shift] = made
        shift += len(made) - (end - start)
    return messages, "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--check", action="store_true", help="list differences")
    action.add_argument("--write", action="store_true", help="replace the tables")
    parser.add_argument("--bismar", type=Path, default=ROOT / "target/release/bismar", help="the program")
    parser.add_argument("--reuse", action="store_true", help="compare what is in out/tables, run nothing")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(COMMANDS))
    options = parser.parse_args()
    for name in options.names:
        if name not in COMMANDS:
            parser.error(f"there is no table '{name}'; there are {', '.join(COMMANDS)}")
    KEPT.mkdir(parents=True, exist_ok=True)
    different = 0
    for name in options.names or COMMANDS:
        kept = KEPT / f"{name}.json"
        if not options.reuse:
            kept.write_text(json.dumps(COMMANDS[name](options.bismar.resolve()), ensure_ascii=False, indent=1))
        for page, new in json.loads(kept.read_text()).items():
            path = ROOT / page
            messages, text = compare(page, path.read_text(), new)
            print(*messages, f"{name}, {page}: {len(messages)} differences", sep="\n")
            different += len(messages)
            if options.write:
                # A page that a command makes as a whole is replaced as a whole.
                path.write_text(new if new.startswith("# ") else text)
    sys.exit(1 if options.check and different else 0)


if __name__ == "__main__":
    main()
