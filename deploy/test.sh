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
# In dev, release and deploy, up to three tests that failed are run once more, by themselves: many measure time, and others
# run beside them. The last lines name those that passed only then.
# CANDELA_DATA names a folder with more test images; tests that need it are skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

[ "${1:-}" != nightly ] || exec deploy/nightly.sh "${@:2}"
presets=("$@")
[ ${#presets[@]} -gt 0 ] || presets=(dev)
lists=(build run test)
[[ " ${presets[*]} " != *' fuzz '* ]] || lists+=(fuzz)
deploy/install-packages.sh "${lists[@]}"

# Runs the tests of a preset.
run_tests() {
  local preset=$1 failures="build/${1/deploy/release}/Testing/Temporary/LastTestsFailed.log"
  rm -f "$failures"
  # One more than the cores, because some tests wait.
  ctest --preset "$preset" --parallel "$(($(nproc) + 1))" && return
  [[ "$preset" =~ ^(dev|release|deploy)$ && -s "$failures" && $(wc -l <"$failures") -le 3 ]] || return 1
  local names
  names=$(cut -d: -f2 "$failures" | paste -sd' ')
  echo "these tests failed and run again, by themselves: $names"
  ctest --preset "$preset" --rerun-failed || return 1
  passed_alone+=("$preset: $names")
}

# The suites whose tests took the most seconds, of which several pass at once.
slowest() {
  awk 'NF == 3 { sub(/\..*/, "", $1); sum[$1] += $3 } END { for (name in sum) printf "%.0f %s\n", sum[name], name }' \
    "build/${1/deploy/release}/Testing/Temporary/CTestCostData.txt" | sort -rn | head -n 8 |
    awk '{ printf "%s%s %d s", (NR > 1 ? ", " : ""), $2, $1 }'
}

passed_alone=()
for preset in "${presets[@]}"; do
  # The other tests are still useful without podman.
  [ "$preset" != deploy ] || deploy/install-packages.sh deploy || echo "tests that need these packages are skipped"
  deploy/build.sh "$preset" -DCANDELA_TESTS=ON
  start=$SECONDS
  run_tests "$preset"
  echo "tested $preset in $((SECONDS - start)) s; the tests took, several at once: $(slowest "$preset")"
done
echo "passed in $SECONDS s: ${presets[*]}"
[ ${#passed_alone[@]} -eq 0 ] || printf 'failed beside others and passed alone, in %s\n' "${passed_alone[@]}"
