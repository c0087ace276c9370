#!/usr/bin/env bash
# Compares Candela with other tools on this machine: compare.sh [FOLDER [ROUNDS]]
#
# Installs the tools (Debian's packages), builds Candela, runs all of them in turn for 7 rounds and writes
# compare.md, compare.json, compare.svg and, of whole commands, files.md into FOLDER (out/compare). Takes some minutes. A
# round waits for a minute at most until other work leaves the processors alone, and the table says what other work used.
set -euo pipefail
cd "$(dirname "$0")/../.."
deploy/install-packages.sh build run test compare
deploy/build.sh release -DCANDELA_TESTS=ON
/usr/bin/python3 -B tests/bench/compare.py build/release/bin "${1:-out/compare}" "${2:-7}"
/usr/bin/python3 -B tests/bench/compare_files.py build/release/bin "${2:-7}" | tee "${1:-out/compare}/files.md"
