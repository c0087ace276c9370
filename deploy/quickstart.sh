#!/usr/bin/env bash
# Installs missing packages, builds Candela, starts candelad and renders HDR frames with it.
#
#   deploy/quickstart.sh                  renders a procedural scene
#   deploy/quickstart.sh FILE...          renders your OpenEXR, Radiance or PFM files
#
# Writes PNG files to out/. Needs Debian 12, and root or sudo if packages are missing. A second run takes seconds.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

# File names are relative to the user's folder.
frames=()
for file in "$@"; do frames+=("$(realpath -m -- "$file")"); done

cd "$root"
deploy/install-packages.sh build run
deploy/build.sh release -DCANDELA_TESTS=OFF
candela=build/release/bin/candela

mkdir -p out
if [ ${#frames[@]} -eq 0 ]; then
  "$candela" sample out/sample.exr --size 1920x1080
  frames=("$root/out/sample.exr")
fi

scratch=$(mktemp -d)
socket=unix:$scratch/candelad.sock
build/release/bin/candelad --listen "$socket" >"$scratch/log" 2>&1 &
daemon=$!
trap 'kill "$daemon" 2>/dev/null || true; wait "$daemon" 2>/dev/null || true; rm -rf "$scratch"' EXIT

# Names the temporary server's socket and folder by what they are.
without_scratch() { sed -e "s|$socket|the temporary candelad|g" -e "s|$scratch|its folder|g"; }

# Wait until it serves. If it cannot, its log says why.
for _ in $(seq 300); do
  "$candela" health --server "$socket" >/dev/null 2>&1 && break
  kill -0 "$daemon" 2>/dev/null || break
  sleep 0.1
done
if ! "$candela" health --server "$socket" >/dev/null 2>&1; then
  without_scratch <"$scratch/log" >&2
  echo "candelad did not start" >&2
  exit 1
fi

declare -A written=()
passed=0
failed=0
for frame in "${frames[@]}"; do
  name=$(basename -- "$frame")
  picture=out/${name%.*}.png
  # Two inputs with the same name get different pictures.
  for ((copy = 2; ${written[$picture]:-0}; copy++)); do picture=out/${name%.*}-$copy.png; done
  written[$picture]=1
  code=0
  "$candela" render "$frame" "$picture" --server "$socket" 2>"$scratch/words" || code=$?
  if [ "$code" -eq 4 ]; then
    # The server is this script's own, so its address would help nobody.
    echo "$frame: candelad did not render it; its log:" >&2
    tail -n 5 "$scratch/log" | without_scratch >&2
  else
    without_scratch <"$scratch/words" >&2
  fi
  if [ "$code" -eq 0 ]; then passed=$((passed + 1)); else failed=$((failed + 1)); fi
done
kill -TERM "$daemon"
wait "$daemon" || { echo "candelad did not stop cleanly" >&2; failed=$((failed + 1)); }

echo
echo "$passed rendered, $failed failed; pictures are in $root/out"
[ "$failed" -eq 0 ]
