"""The programs that Python files start, and the modules that they import."""
import ast
import pathlib
import sys

import shell

# Functions of these modules start a program, or look for one. This argument of theirs names it, or begins with it.
MODULES = {"subprocess", "os", "shutil", "asyncio"}
STARTERS = {"run": 0, "Popen": 0, "call": 0, "check_call": 0, "check_output": 0, "getoutput": 0, "system": 0, "popen": 0,
            "which": 0, "execl": 0, "execlp": 0, "execv": 0, "execve": 0, "execvp": 0, "execvpe": 0, "posix_spawn": 0,
            "posix_spawnp": 0,
            "spawnl": 1, "spawnlp": 1, "spawnv": 1, "spawnvp": 1, "create_subprocess_exec": 0, "create_subprocess_shell": 0}


class File:
    """One file, and what its names may stand for."""

    def __init__(self, text: str):
        self.tree = ast.parse(text)
        self.values: dict[str, list[ast.expr]] = {}  # of a name, wherever it gets one
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    self._name(target, [node.value])
            elif isinstance(node, (ast.AnnAssign, ast.NamedExpr)) and node.value:
                self._name(node.target, [node.value])
            elif isinstance(node, (ast.For, ast.comprehension)) and isinstance(node.iter, (ast.List, ast.Tuple)):
                self._name(node.target, node.iter.elts)
            elif isinstance(node, ast.FunctionDef):
                self.values.setdefault(f"{node.name}()", []).extend(
                    back.value for back in ast.walk(node) if isinstance(back, ast.Return) and back.value)

    def _name(self, target: ast.expr, values: list[ast.expr]) -> None:
        if isinstance(target, ast.Name):
            self.values.setdefault(target.id, []).extend(values)

    def leads(self, node: ast.expr, seen: tuple = ()) -> set[str]:
        """The words with which a command may begin; `=NAME` for a name, which may be a parameter."""
        if isinstance(node, ast.Constant):
            return {node.value} if isinstance(node.value, str) else set()
        if isinstance(node, (ast.List, ast.Tuple)):
            return self.leads(node.elts[0], seen) | behind(node.elts) if node.elts else set()
        if isinstance(node, ast.Starred):
            return self.leads(node.value, seen)
        if isinstance(node, ast.BinOp):
            return self.leads(node.left, seen)
        if isinstance(node, (ast.ListComp, ast.GeneratorExp)):
            return self.leads(node.generators[0].iter, seen)
        if isinstance(node, ast.BoolOp):
            return union(self.leads(value, seen) for value in node.values)
        if isinstance(node, ast.IfExp):
            return self.leads(node.body, seen) | self.leads(node.orelse, seen)
        if isinstance(node, ast.Call):
            return self._values_of(f"{name_of(node.func)}()", seen) | (behind(node.args) if node.args else set())
        if isinstance(node, ast.Name):
            return self._values_of(node.id, seen) | {f"={node.id}"}
        return set()

    def _values_of(self, name: str, seen: tuple) -> set[str]:
        return set() if name in seen else union(self.leads(value, (*seen, name)) for value in self.values.get(name, []))

    def calls(self, starters: dict[str, int], within: ast.AST | None = None):
        """What each call that starts a program begins with."""
        for call in ast.walk(within or self.tree):
            if not isinstance(call, ast.Call):
                continue
            owner = call.func.value.id if isinstance(call.func, ast.Attribute) and isinstance(call.func.value, ast.Name) else ""
            position = (STARTERS if owner in MODULES else starters).get(name_of(call.func))
            if position is None:
                continue
            words = call.args[position:] or [word.value for word in call.keywords if word.arg in ("args", "cmd")]
            if words:
                yield self.leads(words[0]) | behind(words)


def union(sets) -> set[str]:
    return set().union(*sets)


def name_of(function: ast.expr) -> str:
    return function.attr if isinstance(function, ast.Attribute) else function.id if isinstance(function, ast.Name) else ""


def behind(words: list[ast.expr]) -> set[str]:
    """The programs behind one that starts another: `env A=b nginx`, `sh -c 'nginx'`, `taskset -c 1 nginx`."""
    texts = [word.value if isinstance(word, ast.Constant) and isinstance(word.value, str) else shell.GAP for word in words]
    return shell.of_command(texts, {}) if texts[0] in (*shell.PREFIXES, "sh", "bash") else set()


def starters_of(files: list[File]) -> dict[str, int]:
    """The functions of these files that start what a parameter of theirs names, and which parameter that is."""
    found: dict[str, int] = {}
    for _ in range(5):  # one may call another
        for file in files:
            for function in ast.walk(file.tree):
                if not isinstance(function, ast.FunctionDef):
                    continue
                names = [argument.arg for argument in function.args.args + [function.args.vararg] if argument]
                names = names[names[:1] == ["self"]:]
                for leads in file.calls(found, function):
                    found |= {function.name: names.index(lead[1:]) for lead in leads if lead[1:] in names and lead[0] == "="}
    return found


def programs(texts: list[str]) -> list[set[str]]:
    """Of each file. The functions of one may start what another one names."""
    files = [File(text) for text in texts]
    starters = starters_of(files)
    return [union(shell.programs(lead) for leads in file.calls(starters) for lead in leads if not lead.startswith("="))
            for file in files]


def modules(text: str) -> set[str]:
    """The modules that a file imports, without Python's own."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
    return found - sys.stdlib_module_names
