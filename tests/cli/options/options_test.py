"""Every option of every command and of candelad: options_test.py [COMMAND [--OPTION]]

table.py and daemon_table.py say what shows that an option works. An option that `--help` lists and a table lacks is a failure, and so is
an entry for an option that does not exist. So is a choice, such as a curve, that gives the same image as another one.
"""
import pathlib
import subprocess
import sys
import tempfile

import daemon_table
from bench import COMMANDS, Bench
from table import Wrong, table


DAEMON = "candelad"


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


def main() -> None:
    commands = sys.argv[1:2] or (*COMMANDS, DAEMON)
    with tempfile.TemporaryDirectory(prefix="candela-options-") as folder, Bench(pathlib.Path(folder)) as bench:
        wrong = [words for command in commands for words in run_command(bench, command, "".join(sys.argv[2:3]))]
        print(f"{bench.runs} runs of the command")
    if wrong:
        sys.exit("failed:\n" + "\n".join(wrong))


main()
