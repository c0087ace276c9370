#!/usr/bin/env python3
"""Keeps docs/robustness.md, which is made from promises.toml and from figures.json, what tests measured last.

    promises.py                               # fails if the page is not what these two make, or if a name is wrong
    promises.py --write                       # writes the page
    promises.py --record COMMIT FILE...       # takes figures over into figures.json, and writes the page

A name is wrong if no test and no fault of the simulator has it (each fault has to be in a row), if the test is disabled, or if
no test records the figure. Tests are looked for in sources and build files, because no build has all of them: a sanitizer's
lacks some, only `fuzz` has its own.

Tests append figures to the file that CANDELA_TEST_FIGURES names, one in a line: {"figure": NAME, "value": 31.5, "unit": "ms",
"against": 25.0}. `against` is the same of the control, or from before.
"""
import argparse
import fnmatch
import json
import pathlib
import re
import sys
import time
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
PAGE, ROWS, FIGURES = HERE.parent / "docs/robustness.md", HERE / "promises.toml", HERE / "figures.json"
HISTORY = HERE / "simulator/history.cc"  # has the simulator's faults
OWN = {"title", "intro", "end", "text"}  # the keys of promises.toml that are no section
SIMULATED = "sim:"


def sections(rows: dict) -> dict[str, list[dict]]:
    return {title: [{"fault": fault} | row for fault, row in section.items()] for title, section in rows.items()
            if title not in OWN}


def number(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def cell(figure: dict | None) -> str:
    if not figure:
        return ""
    against = f" ({number(figure['against'])})" if "against" in figure else ""
    return f"{number(figure['value'])} {figure['unit']}{against}, {figure['date']}"


def kept_by(row: dict) -> str:
    return ", ".join(("simulator: " if name.startswith(SIMULATED) else "") + f"`{name.removeprefix(SIMULATED)}`"
                     for name in row["tests"])


def page(rows: dict, figures: dict) -> str:
    parts = [f"# {rows['title']}", rows["intro"].strip()]
    for title, promises in sections(rows).items():
        parts += [f"## {title}"] + [text.strip() for text in [rows.get("text", {}).get(title)] if text]
        measured = any("figure" in row for row in promises)
        table = ["| Fault | Promise |" + " Last figure |" * measured + " Tests |", "|---|---|---|" + "---|" * measured]
        for row in promises:
            last = f" {cell(figures.get(row.get('figure')))} |".replace("  ", " ") if measured else ""
            table.append(f"| {row['fault']} | {row['promise']} |{last} {kept_by(row)} |")
        parts.append("\n".join(table))
    machines = sorted({figure["processor"] for figure in figures.values()})
    parts += [f"The figures are of: {'; '.join(machines)}."] if machines else []
    return "\n\n".join(parts + [rows["end"].strip()]) + "\n"


def tests_of_sources(faults: list[str]) -> dict[str, str]:
    """Every test that is not disabled: its name, and the text of the file that has it."""
    tests, built = {}, set()
    for path in sorted(HERE.rglob("CMakeLists.txt")):
        text = re.sub(r"#.*", "", path.read_text())
        words = re.findall(r"[\w./${}]+", text)
        built |= {word.rsplit("/", 1)[-1] for word in words}
        if "DISABLED" in words:
            faults.append(f"{path.relative_to(HERE.parent)} disables a test")
        for suite, claim in re.findall(r"\bNAME (\w+)\.(\S+)", text):
            # The claims of a loop or of a function are among the file's words.
            tests |= {f"{suite}.{word}": text for word in (words if re.fullmatch(r"\$\{\w+\}", claim) else [claim])}
    for path in HERE.rglob("*.cc"):
        text = path.read_text()
        if path.name in built:
            tests |= {f"{suite}.{name}": text
                      for suite, name in re.findall(r"^TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\s*\)", text, re.MULTILINE)}
    return {name: text for name, text in tests.items() if "DISABLED_" not in name}


def wrong_tests(rows: dict, faults: list[str]) -> None:
    tests = tests_of_sources(faults)
    for row in (row for promises in sections(rows).values() for row in promises):
        if not row["tests"]:
            faults.append(f"nothing keeps the promise about \"{row['fault']}\"")
        for pattern in (name for name in row["tests"] if not name.startswith(SIMULATED)):
            name, _, case = pattern.partition("/")
            if not any(f'"{case}"' in tests[test] or not case for test in fnmatch.filter(tests, name)):
                faults.append(f"no test is called {pattern}")


def wrong_faults(rows: dict, faults: list[str]) -> None:
    named = {name.removeprefix(SIMULATED) for promises in sections(rows).values() for row in promises for name in row["tests"]
             if name.startswith(SIMULATED)}
    known = set(re.findall(r'^ *\{"(\w+)", ', HISTORY.read_text(), re.MULTILINE))
    faults += [f"the simulator has no fault {name}" for name in sorted(named - known)]
    faults += [f"no promise names the simulator's fault {name}" for name in sorted(known - named)]


def wrong_figures(rows: dict, figures: dict, faults: list[str]) -> None:
    shown = {row["figure"] for promises in sections(rows).values() for row in promises if "figure" in row}
    faults += [f"no promise shows the figure {name} of figures.json" for name in sorted(figures.keys() - shown)]
    text = "".join(path.read_text() for end in ("*.cc", "*.py") for path in HERE.rglob(end) if not path.name.startswith("promises"))
    # "turns/Bakes" in whole, or "turns/" and the name of a case
    faults += [f"no test records the figure {name}" for name in sorted(shown)
               if f'"{name}"' not in text and f'"{name.partition("/")[0]}/' not in text]


def record(figures: dict, commit: str, files: list[str]) -> None:
    words = pathlib.Path("/proc/cpuinfo").read_text()
    model = re.search(r"^model name\s*: (.*)", words, re.MULTILINE)
    cores = len(re.findall(r"^processor\s*:", words, re.MULTILINE))
    machine = f"{model[1] if model else 'a processor without a name'}, {cores} core{'s' * (cores != 1)}"
    for line in (line for file in files for line in pathlib.Path(file).read_text().splitlines()):
        figure = json.loads(line)
        name = figure.pop("figure")
        figures[name] = figure | {"date": time.strftime("%F", time.gmtime()), "commit": commit, "processor": machine}
    lines = [f"{json.dumps(name)}: {json.dumps(figures[name])}" for name in sorted(figures)]
    FIGURES.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--record", nargs="+", metavar=("COMMIT", "FILE"))
    options = parser.parse_args()
    rows, figures = tomllib.loads(ROWS.read_text()), json.loads(FIGURES.read_text())
    if options.record:
        record(figures, options.record[0], options.record[1:])
    if options.record or options.write:
        PAGE.write_text(page(rows, figures))
    faults: list[str] = []
    wrong_tests(rows, faults)
    wrong_faults(rows, faults)
    wrong_figures(rows, figures, faults)
    if PAGE.read_text() != page(rows, figures):
        faults.append("docs/robustness.md is not what promises.toml and figures.json make: tests/promises.py --write")
    print("\n".join(faults) or "each promise has its tests, and the page shows them")
    sys.exit(bool(faults))


main()
