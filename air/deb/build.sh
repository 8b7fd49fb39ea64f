#!/usr/bin/env bash
# Puts what `make build` built into Debian packages: goshawk-air for the vehicle, goshawk-ros2 for one that ROS 2 feeds,
# goshawk-sim for those who simulate. A vehicle carries nothing of the simulator; a laptop that runs the demo installs it
# beside goshawk-air. `make deb` calls this.
#   air/deb/build.sh amd64 target/release dist     # or arm64, with where its programs are
set -euo pipefail
shopt -s extglob
cd "$(dirname "$0")/../.."
[[ $# == 3 ]] || { sed -n '2,5s/^# *//p' "$0"; exit 2; }
arch=$1 programs=$2 dist=$3
case $arch in
  amd64) triple=x86_64-linux-gnu platform=x86_64-manylinux_2_28 ;;
  arm64) triple=aarch64-linux-gnu platform=aarch64-manylinux_2_28 ;;
  *) echo "build.sh: $arch is neither amd64 nor arm64" >&2; exit 2 ;;
esac
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$dist"

# ONNX Runtime of this processor: the library in the very Python package that ground/requirements.txt pins by its hashes.
sed -n '/^onnxruntime==/,/[^\\]$/p' ground/requirements.txt > "$work/onnxruntime.txt"
.venv/bin/uv pip install -q --target "$work/wheel" --python-platform "$platform" --python-version 3.11 \
  --only-binary :all: --no-deps --require-hashes -r "$work/onnxruntime.txt"
onnxruntime=$work/wheel/onnxruntime

install_program() { # PACKAGE: the program beside the library that it looks for there, and its name on the PATH
  local lib=$work/$1/usr/lib/goshawk
  install -D -t "$lib" "$programs/$1"
  "$triple-strip" --strip-debug "$lib/$1"
  mkdir -p "$work/$1/usr/bin"
  ln -s "../lib/goshawk/$1" "$work/$1/usr/bin/$1"
}

pack() { # PACKAGE DEPENDS DESCRIPTION: control file, copyright, checksums, package
  local root=$work/$1 doc=$work/$1/usr/share/doc/$1
  install -D -m 644 LICENSE "$doc/copyright"
  .venv/bin/python air/deb/licences.py "$1" "${triple/-/-unknown-}" | gzip -9n > "$doc/crates.txt.gz"
  mkdir -p "$root/DEBIAN"
  local glibc
  glibc=$(find "$root" -type f \( -name "$1" -o -name '*.so*' \) -exec objdump -T {} + |
    grep -o 'GLIBC_[0-9.]*' | sed s/GLIBC_// | sort -uV | tail -1)
  cat > "$root/DEBIAN/control" <<EOF
Package: $1
Version: $version
Architecture: $arch
Maintainer: The Goshawk authors <goshawk@localhost>
Section: science
Priority: optional
Installed-Size: $(du -sk "$root" | cut -f1)
Depends: libc6 (>= $glibc), libgcc-s1, libstdc++6$2
Description: $3
EOF
  (cd "$root" && find usr -type f -exec md5sum {} + > DEBIAN/md5sums)
  dpkg-deb --root-owner-group -Zzstd --build "$root" "$dist" > /dev/null
  echo "$dist/$1_${version}_$arch.deb"
}

install_program goshawk-air
install -m 644 -t "$work/goshawk-air/usr/lib/goshawk" "$onnxruntime"/capi/libonnxruntime.so.* "$onnxruntime/capi/libonnxruntime_providers_shared.so"
install -D -m 644 -t "$work/goshawk-air/usr/share/doc/goshawk-air/onnxruntime" "$onnxruntime/LICENSE" "$onnxruntime/ThirdPartyNotices.txt"
install -D -m 644 -t "$work/goshawk-air/usr/share/goshawk/models" air/models/{track,navigate}{,-32bit}.*
install -D -m 644 -t "$work/goshawk-air/usr/share/goshawk/vehicles" air/vehicles/!(paper*)
install -D -m 644 -t "$work/goshawk-air/usr/lib/systemd/system" air/systemd/goshawk-air.service
install -D -m 644 air/systemd/goshawk-air.tmpfiles "$work/goshawk-air/usr/lib/tmpfiles.d/goshawk-air.conf"
install -D -t "$work/goshawk-air/DEBIAN" air/deb/postinst air/deb/prerm
pack goshawk-air ", adduser" "Onboard half of Goshawk, which chases a target through a forest
 The onboard process, its policies, ONNX Runtime, vehicle files and a systemd unit."

# It speaks with the vehicle over the network alone, so it needs nothing of the vehicle's package.
install_program goshawk-ros2
install -D -m 644 -t "$work/goshawk-ros2/usr/share/goshawk" air/sensors/ros2/ros2.toml
install -D -m 644 -t "$work/goshawk-ros2/usr/share/doc/goshawk-ros2" docs/how-to/ros2.md
pack goshawk-ros2 "" "Bridge between ROS 2 and a vehicle of Goshawk
 It speaks what rmw_zenoh speaks, without ROS 2: images and odometry in, what the vehicle tells out."

# What only the simulator flies, to be compared with, is not for a vehicle.
install_program goshawk-sim
install -D -m 644 -t "$work/goshawk-sim/usr/share/goshawk/models" air/models/paper*
install -D -m 644 -t "$work/goshawk-sim/usr/share/goshawk/vehicles" air/vehicles/paper*
pack goshawk-sim ", goshawk-air (= $version)" "Simulator of Goshawk: worlds, flights, campaigns
 It stands in for camera, autopilot and forest. \`goshawk demo\` needs it."
