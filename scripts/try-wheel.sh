#!/bin/bash
# Builds the wheel, installs it into a clean virtual environment (target/wheel-try) and runs python/tests, the types and the
# commands of docs/python.md. --wheel FILE takes a wheel that is there. BISMAR: the program whose pictures they are compared
# with [default: target/debug/bismar, which is built].
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="$PATH:$HOME/.cargo/bin"
if [ "${1:-}" = --wheel ]; then
    wheel=$2
else
    # The profile of the tests: most of it is compiled already.
    scripts/make-wheel.sh dev
    wheel=$(echo target/wheel/*.whl)
fi
if [ -z "${BISMAR:-}" ]; then
    cargo build --quiet --locked --package bismar --bin bismar
    target=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
    export BISMAR=$target/debug/bismar
fi
scripts/setup.sh --python
venv=target/wheel-try
"$venv/bin/pip" --quiet --disable-pip-version-check install --force-reinstall --no-deps "$wheel"
# From another folder: what is imported is the wheel.
cd python/tests
"../../$venv/bin/python" -m mypy --strict --no-incremental --package bismar
"../../$venv/bin/python" -m pytest -q -p no:cacheprovider "${PYTEST_FLAGS:---durations=5}" .
