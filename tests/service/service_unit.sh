#!/bin/sh
# service_unit.sh UNIT CANDELAD: systemd finds nothing to say about the unit, and its exposure is at most 2.0. Neither for it nor
# for the front's unit beside it does systemd give up.
set -eu
unit=$1 program=$2

if ! command -v systemd-analyze > /dev/null; then
  echo "skipped: there is no systemd-analyze here (package systemd)"
  exit 77
fi

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# The program is not installed where the unit looks for it.
sed "s|^ExecStart=/usr/local/bin/candelad|ExecStart=$program|" "$unit" > "$folder/candelad.service"
grep -q "^ExecStart=$program" "$folder/candelad.service"

# It exits with 0 whatever it finds: any output is a failure.
complaints=$(systemd-analyze verify "$folder/candelad.service" 2>&1) || true
if [ -n "$complaints" ]; then
  echo "systemd-analyze verify: $complaints"
  exit 1
fi

# --threshold is in tenths.
if ! systemd-analyze --no-pager --offline=true --threshold=20 security "$folder/candelad.service" > "$folder/exposure"; then
  cat "$folder/exposure"
  exit 1
fi
tail -n 1 "$folder/exposure"

# Time to drain: longer than the defaults of pre-drain (0 s) and drain-timeout (30 s) and the 10 s after them.
stop=$(sed -n 's/^TimeoutStopSec=\([0-9]*\)s$/\1/p' "$unit")
if [ "${stop:-0}" -le 40 ]; then
  echo "TimeoutStopSec is ${stop:-not given in seconds}; candelad may take 40 s to drain"
  exit 1
fi

for file in "$unit" "${unit%/*}/candela-proxy.service"; do
  if ! sed -n '/^\[Unit\]$/,/^\[Service\]$/p' "$file" | grep -qx StartLimitIntervalSec=0; then
    echo "$file: systemd gives up after some failures: [Unit] has no StartLimitIntervalSec=0"
    exit 1
  fi
done
