#!/usr/bin/env bash
# Reads our cube maps with the npm package ktx-parse, which three.js uses: run.sh WRITE_CUBES FOLDER.
# FOLDER, in the build folder, gets the package and the files. Ends with 77 and a reason without node, npm or a registry.
set -euo pipefail
write_cubes=$1 folder=$2
skip() {
  echo "skipped: $1"
  exit 77
}
command -v node >/dev/null || skip "no node"
command -v npm >/dev/null || skip "no npm"
mkdir -p "$folder"
cd "$(dirname "$0")"
cp package.json package-lock.json compare.mjs "$folder"
cd "$folder"
if ! npm ci --prefer-offline --ignore-scripts --no-audit --no-fund --fetch-retries 1 --fetch-timeout 20000 >npm.log 2>&1; then
  if grep -qE 'EINTEGRITY|EUSAGE' npm.log; then
    cat npm.log
    exit 1
  fi
  skip "npm cannot install ktx-parse: $(grep -m 1 'npm error' npm.log || tail -n 1 npm.log)"
fi
rm -f -- *.ktx2
"$write_cubes" .
node compare.mjs .
