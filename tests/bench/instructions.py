#!/usr/bin/env python3
"""Fails if a pass takes 15 % more instructions than recorded. Times on shared machines vary too much to show that.

instructions.py RENDER_COUNTED RECORDED.json             compares
instructions.py RENDER_COUNTED RECORDED.json --host      compares the host's passes alone, in half of the time
instructions.py RENDER_COUNTED RECORDED.json --record    records the present counts
Counts those of the software device, compiled code included, under valgrind, which shows every machine the same
processor. They depend on the versions of Mesa and LLVM and on the vectors' width: with others than recorded it skips (77).
"""
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile

WORSE = 1.15
SKIPPED = 77
# Nothing else of the caller's: its length is counted, in getenv(). The driver's threads would be, too.
ENVIRONMENT = {"LP_NUM_THREADS": "0", "MESA_SHADER_CACHE_DISABLE": "true"}
PASSED_ON = ("PATH", "VK_ICD_FILENAMES", "VK_DRIVER_FILES")


def count(*program: str) -> tuple[str, dict[str, int]]:
    """The device and each pass's instructions, the sum of its levels."""
    with tempfile.TemporaryDirectory(prefix="candela-instructions-") as folder:
        environment = ENVIRONMENT | {name: os.environ[name] for name in PASSED_ON if name in os.environ}
        done = subprocess.run(["valgrind", "--quiet", "--tool=callgrind", "--instr-atstart=no",
                               f"--callgrind-out-file={folder}/out", *program], stdout=subprocess.PIPE, text=True, check=True,
                              env=environment)
        counts: dict[str, int] = {}
        dumps = sorted(pathlib.Path(folder).glob("out.*"), key=lambda path: int(path.suffix[1:]))
        for dump in dumps:
            text = dump.read_text()
            # Dumps of the uncounted time come first and hold nothing.
            name = re.search(r"^desc: Trigger: Client Request: (.+)$", text, re.M)
            total = re.search(r"^totals: (\d+)$", text, re.M)
            if name and total and int(total[1]) > 0:
                counts[name[1]] = counts.get(name[1], 0) + int(total[1])
    return done.stdout.strip(), counts


def compare(recorded: dict[str, int], counted: dict[str, int]) -> list[str]:
    """Prints the table. Returns the problems, one line each."""
    wrong = [f"{name} is {'recorded' if name in recorded else 'counted'} and not the other; record again"
             for name in sorted(recorded.keys() ^ counted.keys())]
    for name, before in recorded.items():
        now = counted.get(name, 0)
        print(f"{name:26} {before:12} {now:12} {100 * (now / before - 1):+7.2f} %")
        if now > WORSE * before:
            wrong.append(f"{name} takes {100 * (now / before - 1):.1f} % more instructions than recorded")
    return wrong


def main() -> int:
    program, path = sys.argv[1], pathlib.Path(sys.argv[2])
    host_only = sys.argv[3:] == ["--host"]
    try:
        device, counted = count(program, *["host"] * host_only)
    except subprocess.CalledProcessError as error:
        if error.returncode != -signal.SIGILL:
            raise
        print("SKIPPED: valgrind does not know an instruction that this processor's libraries use, such as rdtscp where "
              "/proc/cpuinfo does not name it")
        return SKIPPED
    if sys.argv[3:] == ["--record"]:
        path.write_text(json.dumps({"device": device, "instructions": counted}, indent=1) + "\n")
        return 0
    recorded = json.loads(path.read_text())
    if device != recorded["device"]:
        print(f"skipped: recorded on {recorded['device']}, this is {device}")
        return SKIPPED
    wrong = compare({name: number for name, number in recorded["instructions"].items()
                     if name.startswith("host ") or not host_only}, counted)
    print("\n".join(wrong) or f"{len(counted)} passes are no worse than recorded")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
