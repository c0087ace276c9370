#!/usr/bin/env bash
# Runs commands as a stranger would, in a clone on a bare Debian 12: bare-root.sh [--keep FOLDER] [--with PACKAGES] [COMMAND...]
#
# Each COMMAND is one line for bash. Without any, these are the two with which README.md begins. The root is mmdebstrap's
# minbase with /proc, /sys, /dev, /dev/shm and this machine's way to its packages, and nothing else: no ca-certificates (which bring
# openssl), no locale, no git, no name in /etc/hosts. The clone has the last commit, at this tree's own path. CANDELA_DATA
# (../shared/data) is there, too, read-only. --keep copies a folder of the clone into this tree afterwards, if this tree has
# no such folder and no uncommitted changes. --with adds packages, with a comma between two; one named with another architecture
# (libc6:arm64) makes the root take packages of it, too.
#
# Needs root, 12 GB in TMPDIR (/var/tmp) and a mirror. Prints the seconds of each step. What it mounts and starts is in
# namespaces of its own and ends with them, however that happens.
set -euo pipefail
tree=$(cd "$(dirname "$0")/.." && pwd)

# In the namespaces: makes SCRATCH/root with packages from the SOURCES, and runs each command there.
inside() {
  local scratch=$1 sources=$2 data=$3 packages=$4 root=$1/root start=$SECONDS architectures=()
  shift 4
  mapfile -t architectures < <(dpkg --print-architecture && grep -oP ':\K\w+' <<<"$packages" | sort -u)
  mmdebstrap --quiet --variant=minbase --aptopt="$scratch/apt.conf" ${packages:+"--include=$packages"} \
    --architectures="$(IFS=,; echo "${architectures[*]}")" bookworm "$root" "$sources"
  keep_mirror "$sources" "$root"
  mkdir -p "$root$(dirname "$tree")"
  mv "$scratch/clone" "$root$tree"
  mount -t proc proc "$root/proc"
  mount -t sysfs -o ro sysfs "$root/sys"
  mount --rbind /dev "$root/dev"
  mount -t tmpfs -o mode=1777 shm "$root/dev/shm"
  if [ -n "$data" ]; then
    mkdir -p "$root$data"
    mount --bind "$data" "$root$data"
    mount -o remount,bind,ro "$root$data"
  fi
  echo "bare root: made in $((SECONDS - start)) s"
  local variables=(HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin ${data:+"CANDELA_DATA=$data"})
  local name command code
  for name in TERM http_proxy https_proxy no_proxy; do [ -z "${!name:-}" ] || variables+=("$name=${!name}"); done
  for command in "$@"; do
    echo "bare root: $command"
    start=$SECONDS code=0
    env -i "${variables[@]}" chroot "$root" bash -c 'cd "$1" && eval "$2"' bash "$tree" "$command" </dev/null || code=$?
    echo "bare root: $command ended with $code after $((SECONDS - start)) s"
    [ "$code" -eq 0 ] || return "$code"
  done
}

# The root's apt asks the mirror as this machine does.
keep_mirror() {
  local file
  for file in $(grep -oE '/[^][ ]+\.(gpg|asc)' "$1") /etc/apt/trusted.gpg.d /etc/apt/auth.conf /etc/apt/auth.conf.d; do
    [ ! -e "$file" ] || cp --archive --no-clobber --parents "$file" "$2"
  done
  if grep -q https: "$1"; then
    cp /etc/ssl/certs/ca-certificates.crt "$2/etc/apt/mirror.crt"
    echo 'Acquire::https::CaInfo "/etc/apt/mirror.crt";' >"$2/etc/apt/apt.conf.d/zz-mirror"
  fi
}

if [ "${1:-}" = --inside ]; then
  inside "${@:2}"
  exit
fi

keep= packages=
while [[ "${1:-}" == --* ]]; do
  case $1 in
    --keep) keep=${2:?--keep needs a folder} ;;
    --with) packages=${2:?--with needs packages} ;;
    *) echo "bare-root.sh: unknown option $1" >&2; exit 2 ;;
  esac
  shift 2
done
commands=("$@")
if [ $# -eq 0 ]; then
  mapfile -t commands < <(sed -nE 's/^    (deploy\/[a-z]+\.sh) +#.*/\1/p' "$tree/README.md")
  [ ${#commands[@]} -eq 2 ] || { echo "README.md does not begin with two commands of deploy/" >&2; exit 1; }
fi
[ "$(id -u)" -eq 0 ] || { echo "only root can make a root; run this as root" >&2; exit 1; }
cd "$tree"
deploy/install-packages.sh ci
data=$(realpath -m "${CANDELA_DATA:-../shared/data}")
[ -d "$data" ] || data=
sources=
for file in /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list /etc/apt/sources.list.d/*.{sources,list}; do
  if [ -z "$sources" ] && grep -qE '^(deb|Types:.*\bdeb)(\s|$)' "$file" 2>/dev/null; then sources=$file; fi
done
[ -n "$sources" ] || { echo "no file in /etc/apt says where packages are" >&2; exit 1; }
changes=$(git status --porcelain)
[ -z "$changes" ] || echo "bare root: the clone is without this tree's uncommitted changes"

scratch=$(mktemp -d "${TMPDIR:-/var/tmp}/candela-bare.XXXXXX")
child=
remove() {
  if [ -n "$child" ]; then
    kill -KILL "$child" 2>/dev/null || true
    wait "$child" 2>/dev/null || true
  fi
  rm -rf --one-file-system "$scratch" 2>/dev/null || { sleep 1; rm -rf --one-file-system "$scratch"; }
}
trap remove EXIT
trap 'exit 130' INT TERM HUP
chmod 755 "$scratch"
git clone --quiet --no-hardlinks . "$scratch/clone"
apt-config dump --format '%F "%v";%n' Acquire |
  grep -E '^Acquire::(https?(::Proxy)?|Check-Date|Check-Valid-Until|Retries|ForceIPv[46])\b[^ ]* "[^"]' |
  grep -v Auto-Detect >"$scratch/apt.conf" || true

# The first process of a PID namespace takes all others with it, and the last one the mounts.
setpriv --pdeathsig KILL unshare --mount --propagation private --pid --fork --kill-child --mount-proc \
  "$BASH" "$0" --inside "$scratch" "$sources" "$data" "$packages" "${commands[@]}" &
child=$!
code=0
wait "$child" || code=$?
child=
if [ -n "$keep" ] && [ "$code" -eq 0 ] && [ -z "$changes" ] && [ ! -e "$keep" ]; then
  mkdir -p "$(dirname "$keep")"
  cp --archive "$scratch/root$tree/$keep" "$keep"
fi
exit "$code"
