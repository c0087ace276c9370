#!/usr/bin/env bash
# Cross-builds host_bits for arm64, and compares NEON's bits with the recorded ones under qemu: nightly's. The root is its own,
# because this machine's apt, told of another architecture, would upgrade packages. Needs root and a mirror with arm64; takes
# the last commit. On arm64 itself the test HostBits compares them.
set -euo pipefail
cd "$(dirname "$0")/../.."

packages=cmake,g++-aarch64-linux-gnu,libabsl-dev:arm64,libhwy-dev:arm64,libimath-dev:arm64,libprotobuf-dev:arm64,libvulkan-dev:arm64
packages+=,make,pkg-config,protobuf-compiler,qemu-user
build=build/arm64
deploy/bare-root.sh --with "$packages" \
  "cmake -S tests/bits/cross -B $build -DCMAKE_BUILD_TYPE=Release --toolchain $PWD/tests/bits/cross/arm64.cmake" \
  "cmake --build $build --parallel $(nproc)" \
  "qemu-aarch64 $build/host_bits tests/bits/host_bits.txt"
