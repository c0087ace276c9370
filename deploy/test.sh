#!/usr/bin/env bash
# Builds the tests and runs them all: test.sh [PRESET...]
#
# Presets: dev (with the Vulkan validation layers; the default), release (as root with the container's tests, which
# `ctest --preset release -L deploy` runs alone), asan, tsan, and fuzz, which runs each fuzz target for
# CANDELA_FUZZ_SECONDS (30). Installs what is missing.
# CANDELA_DATA names a folder with more images to test on; tests that want it say that they skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
lists=(build run test)
[[ " ${presets[*]} " != *' fuzz '* ]] || lists+=(fuzz)
# The container's tests say that they skip where they are not run by root.
[[ " ${presets[*]} " != *' release '* || $(id -u) -ne 0 ]] || lists+=(deploy)
deploy/install-packages.sh "${lists[@]}"
for preset in "${presets[@]}"; do
  deploy/build.sh "$preset" -DCANDELA_TESTS=ON
  ctest --preset "$preset" --parallel "$(nproc)"
done
echo "passed: ${presets[*]}"
