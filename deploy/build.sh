#!/usr/bin/env bash
# Configures and builds one preset in build/PRESET: build.sh PRESET [CMAKE OPTION...]
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:?usage: build.sh PRESET [CMAKE OPTION...]}
shift
log=build/$preset.log
mkdir -p build
echo "building $preset (log: $log)"
if ! { cmake --preset "$preset" "$@" && cmake --build --preset "$preset"; } >"$log" 2>&1; then
  grep -E -i -A5 'error|failed' "$log" | head -n 40 >&2 || true
  tail -n 5 "$log" >&2
  echo "the build failed; see $log" >&2
  exit 1
fi
echo "built $preset in $SECONDS s"
