#!/usr/bin/env bash
# Adds the frames of a real sequence to a command: real.sh COMMAND... Ends with 77 if there is none.
set -euo pipefail
shopt -s nullglob
frames=("${CANDELA_DATA:-$CANDELA_DATA_DEFAULT}"/sequence/beachball/*.exr)
if [ ${#frames[@]} -eq 0 ]; then
  echo "skipped: no test data; set CANDELA_DATA to its folder"
  exit 77
fi
exec "$@" "${frames[@]}"
