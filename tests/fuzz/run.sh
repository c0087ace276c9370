#!/usr/bin/env bash
# Runs fuzz_image or fuzz_wire for CANDELA_FUZZ_SECONDS (30): run.sh BUILD-FOLDER image|wire [LIBFUZZER OPTION...]
#
# Starts from the seeds of the build, from what earlier runs found (corpus/ here) and, for images, from the damaged ones in
# CANDELA_DATA. Inputs that cover new code are kept in BUILD-FOLDER/corpus for the next run. An input that crashes, takes too
# long or too much memory is left in BUILD-FOLDER/findings.
set -euo pipefail
here=$(dirname "$0")
build=$1 kind=$2
shift 2
corpus=$build/corpus/$kind findings=$build/findings
mkdir -p "$corpus" "$findings"
inputs=("$build/seeds/$kind" "$here/corpus/$kind")
options=(-max_total_time="${CANDELA_FUZZ_SECONDS:-30}" -artifact_prefix="$findings/$kind-" -print_final_stats=1
  -timeout=10)

if [ "$kind" = image ]; then
  data=${CANDELA_DATA:-$here/../../../shared/data}
  for folder in bad radiance; do
    if [ -d "$data/$folder" ]; then
      inputs+=("$data/$folder")
    else
      echo "skipped $data/$folder, which is not there: CANDELA_DATA names a folder with damaged images"
    fi
  done
  # fuzz_image reads at most 8 MiB of pixels from chunks of at most 8 MiB. The largest damaged file has 250 KB.
  # The sanitizer's heap holds 35 MB and its process 500: what was freed stays with it. zstd in a TIFF reserves the 128 MiB
  # that a file may claim, and frees them untouched.
  options+=(-dict="$here/image.dict" -max_len=262144 -malloc_limit_mb=160 -rss_limit_mb=1024)
else
  # protobuf reserves 50 MB for a string that claims that length, and frees it untouched.
  options+=(-max_len=4096 -malloc_limit_mb=64 -rss_limit_mb=512)
fi
exec "$build/bin/fuzz_$kind" "${options[@]}" "$@" "$corpus" "${inputs[@]}"
