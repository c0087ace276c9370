#!/usr/bin/env bash
# Adds the frames of a real sequence to a command: real.sh COMMAND...
set -euo pipefail
shopt -s nullglob
frames=("${CANDELA_DATA:-$CANDELA_DATA_DEFAULT}"/sequence/beachball/*.exr)
[ ${#frames[@]} -gt 0 ] || echo "no test data (set CANDELA_DATA to its folder): a procedural sequence stands in"
exec "$@" "${frames[@]}"
