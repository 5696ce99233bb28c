#!/bin/bash
# Builds container/Containerfile from target/bismar_*.deb (make deb) and tries it: it renders as a user who is not root, the bits
# are those of target/release/bismar where that is there, and SIGTERM reaches the program, which saves and exits with 75.
# Takes podman, buildah or docker, whichever works and gets Debian's image; else, as root, debootstrap and chroot with the same
# steps (container/install.sh). Says so and ends with 0 where none of them works, with CI=true with 69.
set -euo pipefail
cd "$(dirname "$0")/.."
skip() {
    printf 'container: not tried: %s\n' "$*" >&2
    [ "${CI:-}" = true ] && exit 69 || exit 0
}
compgen -G 'target/bismar_*_amd64.deb' >/dev/null || skip "there is no package: make deb"

shared=$(mktemp -d)
root=$PWD/target/container
trap 'umount "$root/proc" 2>/dev/null || true; rm -rf "$shared"' EXIT
cp scenes/cornell.glb "$shared"
chmod 777 "$shared"

builder=
for program in podman buildah docker; do
    if command -v $program >/dev/null && timeout 600 $program build -f container/Containerfile -t bismar . >"$shared/log" 2>&1; then
        builder=$program
        break
    fi
done
if [ -z "$builder" ]; then
    [ "$(id -u)" = 0 ] || skip "neither podman nor buildah nor docker can build it, and debootstrap needs root"
    command -v debootstrap >/dev/null || skip "neither podman, buildah nor docker can build it, and there is no debootstrap"
    builder=chroot
    rm -rf "$root"
    debootstrap --variant=minbase --keyring=/usr/share/keyrings/debian-archive-keyring.gpg trixie "$root" >"$shared/log" ||
        skip "debootstrap got no Debian 13"
    mkdir "$root/tmp/bismar"
    cp target/bismar_*_amd64.deb container/install.sh "$root/tmp/bismar"
    mount -t proc proc "$root/proc"
    chroot "$root" /bin/bash /tmp/bismar/install.sh /tmp/bismar >>"$shared/log" 2>&1 || { cat "$shared/log" >&2; exit 1; }
    umount "$root/proc"
fi
printf 'container: built with %s\n' "$builder"

# Runs the program as the first process of the container, with $shared at /work.
run() {
    case $builder in
    podman | docker) exec $builder run --rm --init=false --name bismar-try -v "$shared:/work" bismar "$@" ;;
    buildah) exec buildah run --isolation chroot --user 10001:10001 -v "$shared:/work" "$(buildah from bismar)" -- bismar "$@" ;;
    chroot)
        exec unshare --mount --pid --fork bash -c '
            mount --bind "$1" "$0/work" && mount -t proc proc "$0/proc" && cd "$0" &&
            exec chroot --userspec=10001:10001 "$0" /usr/bin/env -C /work /usr/bin/bismar "${@:2}"' "$root" "$shared" "$@"
        ;;
    esac
}
# The program's process outside of the container.
inside() { pgrep -n -u 10001 -x bismar; }

(run -q render cornell.glb --size 64x64 --spp 16 -o a.exr --preview a.png)
[ "$(stat -c %u "$shared/a.exr")" = 10001 ] || { echo "container: the picture is not of user 10001" >&2; exit 1; }
if [ -x target/release/bismar ]; then
    target/release/bismar -q render scenes/cornell.glb --size 64x64 --spp 16 -o "$shared/b.exr"
    target/release/bismar compare "$shared/a.exr" "$shared/b.exr" --max-relmse 0
fi
# A long render, ended after its first seconds.
(run -q render cornell.glb --size 512x512 --spp 100000 -o long.exr) &
child=$!
for _ in $(seq 100); do inside >/dev/null && break; sleep 0.1; done
sleep 3
case $builder in
podman | docker) $builder stop -t 60 bismar-try >/dev/null ;;
*) kill -TERM "$(inside)" ;;
esac
code=0
wait $child || code=$?
[ $code = 75 ] && [ -s "$shared/long.exr" ] || { printf 'container: SIGTERM gave exit code %s, not 75\n' $code >&2; exit 1; }
echo "container: it renders as another user than root, and a signal saves the picture"
