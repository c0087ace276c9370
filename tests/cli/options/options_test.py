"""Every option of every command and of candelad: options_test.py [COMMAND [--OPTION]]

`options_test.py --are-all COMMAND...` only checks that these are all the commands that there are.

table.py and daemon_table.py say what shows that an option works. An option that `--help` lists and a table lacks is a failure, and
so is an entry for an option that does not exist. So is a choice, such as a curve, that gives the same image as another one.
"""
import pathlib
import re
import subprocess
import sys
import tempfile

import daemon_table
from bench import DAEMON, Bench, binary
from checks import Wrong
from table import table


def programs() -> set[str]:
    """The commands that `candela --help` lists, and candelad. `help` has no options."""
    words = subprocess.run([binary("candela"), "--help"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                           timeout=60, check=True).stdout
    listed = re.search(r"^Commands:\n((?:  .*\n)+)", words, re.M)
    return {line.split()[0] for line in listed.group(1).splitlines()} - {"help"} | {DAEMON}


def run_command(bench: Bench, command: str, only: str) -> list[str]:
    """The faults of one command's options."""
    rows, listed = daemon_table.ROWS if command == DAEMON else table(command), bench.options(command)
    wrong = [f"{command} {option}: no entry in its table" for option in sorted(listed - rows.keys())]
    wrong += [f"{command} {option}: its table has it, the command does not" for option in sorted(rows.keys() - listed)]
    done: dict = {}
    for option in sorted(listed & rows.keys()):
        if only and option != only:
            continue
        check = rows[option]
        if check not in done:
            try:
                check(bench, command)
                done[check] = ""
            except (Wrong, LookupError, OSError, SystemExit, ValueError, subprocess.SubprocessError) as error:
                done[check] = f"{type(error).__name__}: {error}"
        if done[check]:
            wrong.append(f"{command} {option}: {done[check]}")
            print(wrong[-1], flush=True)
    print(f"{command}: {len(listed)} options", flush=True)
    return wrong


def check_programs(tested: list[str]) -> None:
    if set(tested) != programs():
        sys.exit(f"failed: the test runs for {sorted(tested)}, and there are {sorted(programs())}")


def check_options(commands: list[str], only: str) -> None:
    with tempfile.TemporaryDirectory(prefix="candela-options-") as folder, Bench(pathlib.Path(folder)) as bench:
        wrong = [words for command in commands for words in run_command(bench, command, only)]
        print(f"{bench.runs} runs of the command")
    if wrong:
        sys.exit("failed:\n" + "\n".join(wrong))


if sys.argv[1:2] == ["--are-all"]:
    check_programs(sys.argv[2:])
else:
    check_options(sys.argv[1:2] or sorted(programs()), "".join(sys.argv[2:3]))
