#!/bin/bash
# What LIST.txt pins, from PyPI into a virtual environment of its own: scripts/requirements/install.sh LIST [FOLDER: target/LIST].
# Lists, with versions and hashes, are made by `pip-compile --generate-hashes`.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=${2:-target/$1}
printf 'setup: installing scripts/requirements/%s.txt from PyPI into %s\n' "$1" "$folder" >&2
python3 -m venv "$folder"
"$folder/bin/pip" --quiet --disable-pip-version-check install --require-hashes -r "scripts/requirements/$1.txt" >&2
