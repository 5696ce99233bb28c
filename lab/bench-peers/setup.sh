#!/bin/bash
# Installs the peers into one folder: setup.sh DIR. Mitsuba 3 in DIR/mitsuba with an LLVM for it in DIR/llvm, Blender's
# Cycles in DIR/cycles. The system stays as it is. Says nothing when all is there; about 1.5 GiB.
set -euo pipefail
dir=$1
say() { printf 'bench-peers: %s\n' "$*" >&2; }

venv() { # name, package it must be able to import, list of versions and hashes
    local name=$1 module=$2
    shift 2
    "$dir/$name/bin/python" -c "import $module" 2>/dev/null >&2 && return
    say "installing $name into $dir/$name"
    "${PYTHON:-python3}" -m venv --clear "$dir/$name" || { say "needs Python's venv (Debian: python3-venv)"; exit 1; }
    "$dir/$name/bin/pip" --quiet install --require-hashes -r "$1"
}

mkdir -p "$dir"
here=$(dirname "$0")
venv mitsuba mitsuba "$here/mitsuba.txt"
venv cycles bpy "$here/../../scripts/requirements/blender.txt" || say "no Cycles: bpy 5.0.1 is built for Python 3.11 alone (PYTHON=python3.11 chooses one); 5.3.0, for 3.13, works too"

# Mitsuba's LLVM back end crashes with the LLVM 14 that Debian 12 has as its default; 19 is beside it in both releases.
if [ -z "${DRJIT_LIBLLVM_PATH:-}" ] && ! compgen -G "$dir/llvm/usr/lib/*/libLLVM.so.19*" >/dev/null; then
    say "unpacking libllvm19 into $dir/llvm"
    mkdir -p "$dir/llvm"
    (cd "$dir/llvm" && apt-get -qq download libllvm19 2>/dev/null && dpkg -x libllvm19_*.deb . && rm libllvm19_*.deb) || {
        say "found no libllvm19 with apt-get download (run apt-get update first); set DRJIT_LIBLLVM_PATH to an LLVM of 16 or later"
        exit 1
    }
    lost=$(ldd "$(compgen -G "$dir/llvm/usr/lib/*/libLLVM.so.19*")" | sed -n 's/ => not found//p' | xargs)
    [ -z "$lost" ] || { say "libllvm19 also needs $lost: apt-get install libllvm19 brings them"; exit 1; }
fi
