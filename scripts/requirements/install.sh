#!/bin/bash
# A tool from PyPI, by its hashes, into target/NAME: scripts/requirements/install.sh NAME. Says where its programs are.
set -euo pipefail
cd "$(dirname "$0")/../.."
name=$1
if ! [ -x "target/$name/bin/cargo-$name" ]; then
    printf '%s: installing cargo-%s from PyPI into target/%s\n' "$name" "$name" "$name" >&2
    python3 -m venv "target/$name"
    "target/$name/bin/pip" --quiet --disable-pip-version-check install --require-hashes -r "scripts/requirements/$name.txt" >&2
fi
printf '%s\n' "$PWD/target/$name/bin"
