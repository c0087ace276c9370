#!/usr/bin/env bash
# Installs Candela into a temporary folder, builds the example against it and runs it with the installed candelad.
# Usage: run.sh BUILD_FOLDER CXX_COMPILER CXX_FLAGS
set -euo pipefail
cd "$(dirname "$0")"
build=$1
scratch=$(mktemp -d)
daemon=
trap '[ -z "$daemon" ] || kill "$daemon" || true; rm -rf "$scratch"' EXIT

cmake --install "$build" --prefix "$scratch/install" >"$scratch/log"
# The example must not find anything in the source tree.
mkdir "$scratch/source"
cp CMakeLists.txt main.cc "$scratch/source"
cmake -S "$scratch/source" -B "$scratch/build" -G Ninja -DCMAKE_PREFIX_PATH="$scratch/install" \
  -DCMAKE_CXX_COMPILER="$2" -DCMAKE_CXX_FLAGS="$3" >>"$scratch/log" 2>&1 || { cat "$scratch/log"; exit 1; }
cmake --build "$scratch/build"

mkfifo "$scratch/says"
"$scratch/install/bin/candelad" --listen "unix:$scratch/socket" --log-level off >"$scratch/says" &
daemon=$!
read -r line <"$scratch/says"
[[ $line == listening* ]] || { echo "candelad says: $line"; exit 1; }
"$scratch/build/example" "unix:$scratch/socket" | tee "$scratch/out"
[ "$(wc -l <"$scratch/out")" -eq 24 ]
