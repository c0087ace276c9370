#!/usr/bin/env bash
# Builds the tests and runs them all: test.sh [PRESET...]
#
# Presets: dev (with the Vulkan validation layers; the default), release, asan, tsan. Installs what is missing.
# CANDELA_DATA names a folder with more images to test on; tests that want it say that they skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."
deploy/install-packages.sh build run test

presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
for preset in "${presets[@]}"; do
  deploy/build.sh "$preset" -DCANDELA_TESTS=ON
  ctest --preset "$preset"
done
echo "passed: ${presets[*]}"
