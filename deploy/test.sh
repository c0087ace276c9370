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
# Nothing runs a second time: tests that measure latency are nightly's (label `long` or `nightly`).
# CANDELA_DATA names a folder with more test images; tests that need it are skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

[ "${1:-}" != nightly ] || exec deploy/nightly.sh "${@:2}"
presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
lists=(build run python test)
[[ " ${presets[*]} " != *' fuzz '* ]] || lists+=(fuzz)
deploy/install-packages.sh "${lists[@]}"

# The suites whose tests took the most seconds, of which several pass at once.
slowest() {
  awk 'NF == 3 { sub(/\..*/, "", $1); sum[$1] += $3 } END { for (name in sum) printf "%.0f %s\n", sum[name], name }' \
    "build/${1/deploy/release}/Testing/Temporary/CTestCostData.txt" | sort -rn | head -n 8 |
    awk '{ printf "%s%s %d s", (NR > 1 ? ", " : ""), $2, $1 }'
}

for preset in "${presets[@]}"; do
  # The other tests are still useful without podman.
  [ "$preset" != deploy ] || deploy/install-packages.sh deploy || echo "tests that need these packages are skipped"
  deploy/build.sh "$preset" -DCANDELA_TESTS=ON
  start=$SECONDS
  # One more than the cores, because some tests wait.
  ctest --preset "$preset" --parallel "$(($(nproc) + 1))"
  echo "tested $preset in $((SECONDS - start)) s; the tests took, several at once: $(slowest "$preset")"
done
echo "passed in $SECONDS s: ${presets[*]}"
