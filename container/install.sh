#!/bin/bash
# install.sh FOLDER: the steps of the Containerfile inside of a Debian 13: the package in FOLDER with what it needs, and a user.
set -euo pipefail
export DEBIAN_FRONTEND=noninteractive
apt-get -q update
apt-get -q install -y --no-install-recommends "$1"/bismar_*.deb
rm -rf /var/lib/apt/lists/* /var/cache/apt/archives/*.deb
groupadd --gid 10001 bismar
useradd --uid 10001 --gid bismar --no-create-home --home-dir /work --shell /usr/sbin/nologin bismar
install -d -o bismar -g bismar /work
