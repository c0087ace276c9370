#!/usr/bin/env bash
# Builds and runs all tests: test.sh [PRESET...]
#
# Presets:
#   dev      with the Vulkan validation layers (the default)
#   release, asan, tsan
#   fuzz     runs each fuzz target for CANDELA_FUZZ_SECONDS (30)
#   deploy   the release build's container, proxy, manifest, alerts, dashboard and instruction counts
#   nightly  hours: the sanitizers, long fuzzing, a soak and every attack; test.sh nightly [PART...], see nightly.sh
# Installs missing packages. Container tests need root. Tests that cannot run on this machine are reported as skipped.
# CANDELA_DATA names a folder with more test images; tests that need it are skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

[ "${1:-}" != nightly ] || exec deploy/nightly.sh "${@:2}"
presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
lists=(build run test)
[[ " ${presets[*]} " != *' fuzz '* ]] || lists+=(fuzz)
deploy/install-packages.sh "${lists[@]}"
for preset in "${presets[@]}"; do
  # The other tests are still useful without podman.
  [ "$preset" != deploy ] || deploy/install-packages.sh deploy || echo "tests that need these packages are skipped"
  deploy/build.sh "$preset" -DCANDELA_TESTS=ON
  # One more than the cores, because some tests wait.
  ctest --preset "$preset" --parallel "$(($(nproc) + 1))"
done
echo "passed: ${presets[*]}"
