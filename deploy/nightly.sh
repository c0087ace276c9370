#!/usr/bin/env bash
# The tests that take hours, in parts: nightly.sh [PART...]. deploy/test.sh nightly runs it.
#
#   files      compiles each source file by itself, to find one that lacks an include
#   asan       the tests of dev and the long ones, with the address and undefined-behaviour sanitizers
#   tsan       the same with the thread sanitizer
#   device     the same on the release build, with the device's passes in place of the host's
#   fuzz       each fuzz target for 30 minutes
#   arm64      the bits of the host's executor on NEON, cross-built in a root of its own and run under qemu; needs root
#   simulator  a million simulated histories of sessions, of other seeds each night (tests/simulator)
#   planted    shows that the simulator finds planted mistakes
#   soak       20 minutes of mixed traffic with faults
#   attacks    tests/robustness, and all tests of the release build that are long, or measure latencies or instructions
#   edge       the attacks on the shipped containers and on processes, two containers behind HAProxy, a container with little
#              memory, and the image for GPUs; needs root and podman
#
# Without PART it runs the parts that have not passed yet on this commit, or on one from which it differs in documentation
# only. A part in which a test was skipped is "incomplete": asan and tsan need CANDELA_DATA. A part that ran in a tree with
# uncommitted changes is "uncommitted", and does not count as passed: two such trees have the same commit. build/nightly
# keeps each part's result and log. With fewer CANDELA_FUZZ_SECONDS or CANDELA_SOAK_SECONDS than here, that part is "shortened",
# and does not count as passed either. When soak, attacks or edge has passed, its figures go into tests/figures.json and
# docs/robustness.md, which are to be committed; changes of these two files do not count.
set -euo pipefail
cd "$(dirname "$0")/.."

all=(files asan tsan device fuzz arm64 simulator planted soak attacks edge)
declare -A whole=([fuzz]=1800 [soak]=1200)  # seconds
declare -A seconds=([fuzz]=${CANDELA_FUZZ_SECONDS:-${whole[fuzz]}} [soak]=${CANDELA_SOAK_SECONDS:-${whole[soak]}})
measures=(soak attacks edge)  # parts whose tests record figures
results=build/nightly
deploy/install-packages.sh ci
commit=$(git rev-parse --short=12 HEAD)

run_files() {
  deploy/install-packages.sh build run python test
  cmake --preset dev -B build/files -DCMAKE_UNITY_BUILD=OFF -DCMAKE_CXX_FLAGS_DEBUG= && cmake --build build/files
}
run_asan() { deploy/test.sh asan; }
run_tsan() { deploy/test.sh tsan; }
run_device() {
  build_with_tests release
  # The instruction counts are of both kinds of passes, whatever the tests use.
  ctest --preset device --parallel "$(($(nproc) + 1))" --exclude-regex '^Bench'
}
run_fuzz() { CANDELA_FUZZ_SECONDS=${seconds[fuzz]} deploy/test.sh fuzz; }
run_arm64() { tests/bits/arm64.sh; }
run_simulator() {
  build_with_tests release
  local first
  first=$(date -u +%Y%m%d)000000
  echo "seeds from $first on"
  build/release/bin/candela_simulator --histories 1000000 --seed "$first"
}
run_planted() {
  deploy/install-packages.sh build run python test
  tests/simulator/planted.py
}
run_soak() {
  build_with_tests release
  CANDELA_SOAK_SECONDS=${seconds[soak]} ctest --preset soak
}
run_attacks() {
  deploy/install-packages.sh deploy
  build_with_tests release
  ctest --preset attacks
}
run_edge() {
  deploy/install-packages.sh deploy
  build_with_tests deploy
  ctest --preset edge
}

build_with_tests() {
  deploy/install-packages.sh build run python test
  deploy/build.sh "$1" -DCANDELA_TESTS=ON
}

# The tree is the commit that this script began with, without changes and new files, but for the figures.
is_commit() { [ "$(git rev-parse --short=12 HEAD)" = "$commit" ] && [ -z "$(git status --porcelain -- . ':(exclude)tests/figures.json' ':(exclude)docs/robustness.md')" ]; }

# "VERDICT COMMIT DATE SECONDS s" of a part, or nothing. VERDICT is passed, failed, incomplete, shortened or uncommitted.
result() { cat "$results/$1.txt" 2>/dev/null || true; }

passed() {
  local verdict on rest
  read -r verdict on rest <<<"$(result "$1")"
  [ "$verdict" = passed ] && is_commit && git diff --quiet "$on" "$commit" -- . ':(exclude)tests/figures.json' ':(exclude)docs' ':(exclude)*.md' 2>/dev/null
}

run_part() {
  local part=$1 start=$SECONDS verdict=failed tree=uncommitted figures=
  if is_commit; then tree=committed; fi
  if [[ " ${measures[*]} " == *" $part "* ]]; then figures=$PWD/$results/$part.figures && : >"$figures"; fi
  echo "$part: running (log: $results/$part.log)"
  # A new shell, so that a failure inside the function ends it.
  if CANDELA_TEST_FIGURES=$figures "$BASH" "$0" --inside "$part" >"$results/$part.log" 2>&1 </dev/null; then verdict=passed; fi
  if [ "$verdict" = passed ] && grep -qE '\*\*\*Skipped' "$results/$part.log"; then verdict=incomplete; fi
  if [ "$verdict" = passed ] && [ "${seconds[$part]:-0}" -lt "${whole[$part]:-0}" ]; then verdict=shortened; fi
  is_commit || tree=uncommitted  # it was changed meanwhile
  if [ "$verdict" = passed ] && [ $tree = uncommitted ]; then verdict=uncommitted; fi
  echo "$verdict $commit $(date -u +%F) $((SECONDS - start)) s" >"$results/$part.txt"
  echo "$part: $(result "$part")"
  if [ "$verdict" = passed ] && [ -n "$figures" ]; then tests/promises.py --record "$commit" "$figures" || true; fi
}

if [ "${1:-}" = --inside ]; then
  "run_$2"
  exit
fi
for part in "$@"; do
  [[ " ${all[*]} " == *" $part "* ]] || { echo "nightly.sh: no part '$part'; there are: ${all[*]}" >&2; exit 2; }
done
mkdir -p "$results"
is_commit || echo "the tree has uncommitted changes, so no part can pass" >&2
for part in "${@:-${all[@]}}"; do
  if [ $# -eq 0 ] && passed "$part"; then continue; fi
  run_part "$part"
done
missing=0
for part in "${@:-${all[@]}}"; do
  printf '%-9s %s\n' "$part" "$(result "$part")"
  passed "$part" || missing=1
done
exit "$missing"
