#!/usr/bin/env bash
# Installs wheel and packages in a Debian that has nothing else and no network, and flies the demo there as a plain user.
# `make test-install` calls this. Needs root, debootstrap and iproute2.
#   tests/install/clean_root.sh dist          # a new Debian each time, some minutes
#   tests/install/clean_root.sh dist BASE     # in a copy of one that debootstrap has made before
set -euo pipefail
cd "$(dirname "$0")/../.."
[[ $# == 1 || $# == 2 ]] || { sed -n '2,5s/^# *//p' "$0"; exit 2; }
[[ $(id -u) == 0 ]] || { echo "clean_root.sh: run it as root: it makes a root folder of its own" >&2; exit 1; }
for tool in debootstrap ip unshare; do
  command -v "$tool" > /dev/null || { echo "clean_root.sh: $tool is missing: apt-get install debootstrap iproute2 util-linux" >&2; exit 1; }
done
suite=bookworm
packages=python3,python3-venv,adduser,libstdc++6
work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
trap 'exit 130' INT TERM
root=$work/root

say() { echo "== $*"; }

say "wheels of what ground/requirements.txt pins"
sed '/^onnxruntime==/,/[^\\]$/d' ground/requirements.txt > "$work/pins.txt" # the vehicle's package brings its own
.venv/bin/pip download -q --disable-pip-version-check --require-hashes --no-deps --only-binary :all: -d "$work/wheels" -r "$work/pins.txt"

if [[ $# == 2 ]]; then
  say "a copy of $2"
  cp -a "$2" "$root"
else
  say "Debian $suite, minimal, with $packages"
  debootstrap --variant=minbase --include="$packages" "$suite" "$root" > "$work/debootstrap.log" || { tail -5 "$work/debootstrap.log" >&2; exit 1; }
fi
mkdir -p "$root/dist"
cp "$1"/*.whl "$1"/*_"$(dpkg --print-architecture)".deb "$work"/wheels/* "$root/dist"

cat > "$root/install-and-fly" <<'EOF'
#!/bin/sh -e
export DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t tmpfs tmpfs /dev/shm
say() { echo "== $*"; }
say "apt installs the packages"
apt-get install -qq -o Dpkg::Use-Pty=0 /dist/*.deb > /dev/null
dpkg -l goshawk-air goshawk-ros2 goshawk-sim | tail -3
id goshawk
say "pip installs the wheel from the pins alone"
python3 -m venv /opt/goshawk
/opt/goshawk/bin/pip install -q --disable-pip-version-check --no-index --find-links /dist goshawk
useradd --create-home pilot
fly() { su pilot -c "cd && PATH=/opt/goshawk/bin:\$PATH $*"; }
say "goshawk doctor"
fly goshawk doctor --offline --role laptop
say "goshawk-air check, of the packaged policy, with nothing connected"
fly 'goshawk-air check --config /usr/share/goshawk/vehicles/sim.toml --log-dir logs --wait 1 || test $? = 1'
say "goshawk-ros2 reads the packaged file"
fly goshawk-ros2 --config /usr/share/goshawk/ros2.toml --check
say "goshawk demo"
fly goshawk demo --headless
say "what is left after apt has removed them"
apt-get remove -qq -o Dpkg::Use-Pty=0 goshawk-air goshawk-ros2 goshawk-sim > /dev/null
test ! -e /usr/lib/goshawk && test ! -e /usr/bin/goshawk-air && echo "nothing of the programs"
EOF
chmod +x "$root/install-and-fly"
say "into it: no network but its own loopback"
unshare --mount --net --pid --fork --kill-child bash -ec "ip link set lo up; exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin chroot '$root' /install-and-fly"
say "wheel and packages work in a clean Debian $suite"
