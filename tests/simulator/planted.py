#!/usr/bin/env python3
"""Shows that the simulator finds mistakes: plants those of planted.toml, one at a time, and runs histories until one is wrong.

usage: planted.py [NAME...]    all of them, or some

It works in a copy of the sources, build/planted, and keeps the build there. It prints what it took to find each, and writes
a table of all of them to build/planted/found.md. Exit code 1 if one was not found, or if one that has to be right is not.
CANDELA_HISTORIES: how many it runs for each (20000). CANDELA_SEED: the first one's seed (1).
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
COPY = ROOT / "build" / "planted"
BUILD = COPY / "build" / "release"
HISTORIES = os.environ.get("CANDELA_HISTORIES", "20000")
SEED = os.environ.get("CANDELA_SEED", "1")
OTHER = {".git", "build", "out", "__pycache__"}  # no sources
LIMIT = 1800  # seconds for the histories of one


def write(path: pathlib.Path, text: bytes) -> None:
    """Leaves a file that is the same alone, so that nothing is built for it."""
    if not path.exists() or path.read_bytes() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text)


def copy_sources() -> None:
    for folder, folders, names in os.walk(ROOT):
        folders[:] = [name for name in folders if name not in OTHER]
        for name in set(names) - OTHER:
            path = pathlib.Path(folder, name)
            write(COPY / path.relative_to(ROOT), path.read_bytes())
            shutil.copymode(path, COPY / path.relative_to(ROOT))


def build() -> None:
    made = subprocess.run(["cmake", "--build", BUILD, "--target", "candela_simulator"], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT)
    if made.returncode != 0:
        sys.exit(f"planted.py: it does not build:\n{made.stdout[-4000:]}")


def planted(fault: dict) -> dict[pathlib.Path, bytes]:
    """The files that the fault changes, as they are with it."""
    files: dict[pathlib.Path, bytes] = {}
    for name, old, new in fault["edits"]:
        path = COPY / name
        text = files.get(path, path.read_bytes()).decode()
        if text.count(old) != 1:
            sys.exit(f"planted.py: {fault['name']}: {name} holds {text.count(old)} times, and not once:\n{old}")
        files[path] = text.replace(old, new).encode()
    return files


def verdict(histories: str) -> tuple[str | None, str]:
    """After how many histories one was wrong, and how; None if all were right."""
    program = BUILD / "bin" / "candela_simulator"
    try:
        ran = subprocess.run([program, "--histories", histories, "--seed", SEED], text=True, stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return None, f"it took longer than {LIMIT} s"
    if ran.returncode == 0:
        return None, ran.stdout.splitlines()[0]
    if wrong := re.search(r"^history (\d+) of \d+ is wrong: (.*)", ran.stdout, re.M):
        return wrong[1], wrong[2]
    if died := re.search(r"^to see it: .* --replay (\d+)$", ran.stdout, re.M):  # a failed CHECK
        return str(int(died[1]) - int(SEED) + 1), ran.stdout.splitlines()[0]
    return None, f"it ended with {ran.returncode}: {ran.stdout[-500:]}"


def main() -> int:
    faults = tomllib.loads((ROOT / "tests" / "simulator" / "planted.toml").read_text())["fault"]
    if unknown := set(sys.argv[1:]) - {fault["name"] for fault in faults}:
        sys.exit(f"planted.py: there is no {' '.join(sorted(unknown))}")
    copy_sources()
    for fault in faults:  # before anything is built
        planted(fault)
    subprocess.run(["cmake", "--preset", "release", "-DCANDELA_TESTS=ON"], cwd=COPY, check=True, stdout=subprocess.DEVNULL)
    rows = ["| planted in | mistake | histories |", "|---|---|---|"]
    print(f"{len(sys.argv[1:]) or len(faults)} faults, up to {HISTORIES} histories each from seed {SEED}", flush=True)
    bad = 0
    for fault in faults:
        if sys.argv[1:] and fault["name"] not in sys.argv[1:]:
            continue
        files = planted(fault)
        before = {path: path.read_bytes() for path in files}
        try:
            for path, text in files.items():
                path.write_bytes(text)
            build()
            taken, words = verdict(str(max(int(HISTORIES), fault.get("histories", 0))))
        finally:
            for path, text in before.items():
                path.write_bytes(text)
        right = fault.get("right", False)
        bad += (taken is None) != right
        words = re.sub(r"\S*/build/planted/", "", words)[:120]
        print(f"{fault['name']:24} {'right' if taken is None else taken:>6}  {words}", flush=True)
        rows.append(f"| {fault['edits'][0][0]} | {fault['what']} | {taken or 'right'} |")
    if not sys.argv[1:]:
        (COPY / "found.md").write_text("\n".join(rows) + "\n")
    if bad:
        print(f"{bad} are not as they should be")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
