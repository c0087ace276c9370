"""The programs that C++, CMake and container files start."""
import json
import re

import shell

ABSOLUTE = re.compile(r"(?<![\w.}])/(?:usr/)?s?bin/([a-z][\w+.-]*)")
STRING = r'"((?:[^"\\]|\\.)*)"'


def of_cpp(text: str) -> set[str]:
    """A program is named by a whole path, or by a name where the PATH is searched. `?` stands for a name that is not found."""
    code = re.sub(r"^\s*(//|#).*$", "", text, flags=re.M)
    found = {name for words in re.findall(STRING, code) for name in ABSOLUTE.findall(words)}
    for words in re.findall(rf"\b(?:std::system|system|popen|\w+_in_shell)\(\s*{STRING}", code):
        found |= shell.programs(words)
    for first in re.findall(r"\b(?:execlp|execvpe?)\(\s*([^,)]+)|\bposix_spawnp\([^,]+,\s*([^,]+)", code):
        word = "".join(first)
        name = re.match(r"\w*", word).group()
        values = [word[1:-1]] if word.startswith('"') else re.findall(rf"\b{name}\s*[=({{]\s*{STRING}", code)
        found |= {value.rsplit("/", 1)[-1] for value in values} or {"?"}
    return found


def of_cmake(text: str) -> set[str]:
    """Commands of tests and rules, programs that are looked for, and targets of others' packages."""
    code = re.sub(r"#.*", "", text)
    found = set(ABSOLUTE.findall(code)) | set(re.findall(r"\bCOMMAND\s+([a-z][\w+.-]*)\s", code))
    found |= {name for words in re.findall(r"\bfind_program\(\s*\w+\s+(?:NAMES\s+)?([^)]*)", code)
              for name in words.split() if re.fullmatch(r"[a-z][\w+.-]*", name)}
    for target in re.findall(r"\bCOMMAND\s+\w+::(\w+)", code):
        found.add("python3" if target == "Interpreter" else target)
    return found


def of_containerfile(text: str) -> set[str]:
    """What RUN starts while the image is made, and what its processes are."""
    lines = re.sub(r"\\\n", " ", re.sub(r"^\s*#.*\n", "", text, flags=re.M)).splitlines()
    found: set[str] = set()
    for line in lines:
        word, _, rest = line.partition(" ")
        if word == "RUN":
            found |= shell.programs(re.sub(r"--\w+=\S+", "", rest))
        for words in re.findall(r"(?:ENTRYPOINT|CMD)\s+(\[.*\])", line):
            found.add(json.loads(words)[0])
    return found
