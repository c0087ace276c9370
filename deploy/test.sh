#!/usr/bin/env bash
# Builds the tests and runs them all: test.sh [PRESET...]
#
# Presets: dev (with the Vulkan validation layers; the default), release, asan, tsan, fuzz, which runs each fuzz target
# for CANDELA_FUZZ_SECONDS (30), and deploy: the release build's container, proxy, manifest, alerts, dashboard and
# instruction counts. Containers want root; what a machine cannot do is reported as skipped. Installs what is missing.
# CANDELA_DATA names a folder with more images to test on; tests that want it say that they skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
lists=(build run test)
[[ " ${presets[*]} " != *' fuzz '* ]] || lists+=(fuzz)
deploy/install-packages.sh "${lists[@]}"
for preset in "${presets[@]}"; do
  # Without podman and its kind the other tests still tell something.
  [ "$preset" != deploy ] || deploy/install-packages.sh deploy || echo "what wants them is skipped"
  deploy/build.sh "$preset" -DCANDELA_TESTS=ON
  ctest --preset "$preset" --parallel "$(nproc)"
done
echo "passed: ${presets[*]}"
