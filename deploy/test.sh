#!/usr/bin/env bash
# Builds the tests and runs them all: test.sh [PRESET...]
#
# Presets: dev (with the Vulkan validation layers; the default), release, asan, tsan, fuzz, which runs each fuzz target
# for CANDELA_FUZZ_SECONDS (30), and deploy: the release build's container, proxy, manifest, alerts and dashboard, which
# wants root. Installs what is missing.
# CANDELA_DATA names a folder with more images to test on; tests that want it say that they skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
lists=(build run test)
[[ " ${presets[*]} " != *' fuzz '* ]] || lists+=(fuzz)
[[ " ${presets[*]} " != *' deploy '* ]] || lists+=(deploy)
deploy/install-packages.sh "${lists[@]}"
for preset in "${presets[@]}"; do
  if [ "$preset" = deploy ]; then
    deploy/build.sh release -DCANDELA_TESTS=ON -DCANDELA_DEPLOY_TESTS=ON
    ctest --preset release -L deploy
  else
    deploy/build.sh "$preset" -DCANDELA_TESTS=ON -DCANDELA_DEPLOY_TESTS=OFF
    ctest --preset "$preset" --parallel "$(nproc)"
  fi
done
echo "passed: ${presets[*]}"
