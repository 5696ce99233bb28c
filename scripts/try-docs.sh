#!/bin/bash
# Runs the commands of docs/guide.md, gallery.md, cameras.md, check.md and datasets.md (or of the files named) as they stand,
# from the repository's root, with target/release first in the path; stops at the first that fails. Results are in out/.
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- docs/guide.md docs/gallery.md docs/cameras.md docs/check.md docs/datasets.md
export PATH="$PWD/target/release:$PATH"
command -v bismar >/dev/null && command -v bismar-study >/dev/null || { echo "make build first" >&2; exit 64; }
mkdir -p out
for file in "$@"; do
    echo "== $file"
    # What stands between ```sh and ```.
    bash -euxo pipefail <(sed -n '/^```sh$/,/^```$/{/^```/!p}' "$file")
done
