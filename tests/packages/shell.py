"""The programs that a shell script starts: reads bash as far as that needs."""
import re

BUILTINS = set(""": . [ alias bg break cd continue declare dirs echo eval exit export false fg getopts hash help jobs kill let
local mapfile popd printf pushd pwd read readarray readonly return set shift shopt source test times trap true type typeset
ulimit umask unalias unset wait for select function in""".split())
KEYWORDS = {"if", "then", "else", "elif", "fi", "do", "done", "while", "until", "!", "{", "}", "time", "coproc"}
# They start the program that follows their own options, and these options take a word.
PREFIXES = {"command": "", "exec": "a", "env": "uCS", "nice": "n", "nohup": "", "setsid": "", "sudo": "ug", "timeout": "ks",
            "xargs": "adEILnPs", "chroot": "", "unshare": "", "taskset": "c", "setpriv": ""}
BLANK, ENDS = " \t", " \t\n;&|<>()"
GAP = "\0"  # in a word: what only the shell knows


class Commands:
    """The simple commands of a script, as lists of words. Those inside $(...) and <(...) are among them."""

    def __init__(self, text: str):
        self.text, self.at, self.found, self.arrays, self.functions, self.documents = text, 0, [], {}, set(), []
        while self.at < len(text):
            self._list()

    def _peek(self, length: int = 1) -> str:
        return self.text[self.at:self.at + length]

    def _skip_to(self, end: str) -> None:
        found = self.text.find(end, self.at)
        self.at = len(self.text) if found < 0 else found + len(end)

    def _list(self, inside_case: bool = False) -> bool:
        """Commands up to an unmatched ')' or the end. In a branch of `case` also up to ';;'; True if `esac` ended it."""
        words: list[str] = []
        while self.at < len(self.text):
            c = self._peek()
            if c in BLANK or self._peek(2) == "\\\n":
                self.at += 1 if c in BLANK else 2
            elif c == "#":
                self.at = self.text.find("\n", self.at) if "\n" in self.text[self.at:] else len(self.text)
            elif c in "\n;&|":
                words = self._end(words)
                if inside_case and self._peek(2) in (";;", ";&"):
                    self.at += 2
                    return False
                self.at += 1
                if c == "\n":
                    self._skip_documents()
            elif self._peek(2) == "((":
                self._through("))")
            elif c == "(":
                self.at += 1
                self._list()
            elif c == ")":
                self.at += 1
                break
            elif c in "<>" or re.match(r"\d+[<>]", self.text[self.at:self.at + 4]):
                self._redirection()
            else:
                word = self._word()
                if not words and word in KEYWORDS:
                    continue
                if not words and word == "[[":
                    self._through(" ]]")
                elif not words and word == "case":
                    self._case()
                elif not words and word == "esac":
                    return True
                elif self._peek(2) == "()":
                    self.functions.add(word)
                    self.at += 2
                else:
                    words.append(word)
        self._end(words)
        return False

    def _end(self, words: list[str]) -> list[str]:
        if words:
            self.found.append(words)
        return []

    def _case(self) -> None:
        self._blank()
        self._word()
        self._blank()
        self._word()  # in
        while self.at < len(self.text):
            self._blank()
            if self._peek(4) == "esac":
                self.at += 4
                return
            while self.at < len(self.text) and self._peek() != ")":  # a pattern
                if self._peek() in BLANK + "|(\n":
                    self.at += 1
                else:
                    self._word()
            self.at += 1
            if self._list(inside_case=True):
                return

    def _blank(self) -> None:
        while self._peek() and (self._peek() in BLANK + "\n" or self._peek() == "#"):
            if self._peek() == "#":
                self._skip_to("\n")
            else:
                self.at += 1

    def _redirection(self) -> None:
        operator = re.match(r"\d*(?:<\(|>\(|<<<|<<-?|<&|>&|>>|>\||<>|<|>)", self.text[self.at:]).group()
        self.at += len(operator)
        if operator.endswith("("):
            self._list()
            return
        while self._peek() and self._peek() in BLANK:
            self.at += 1
        word = self._word() if not self._peek() or self._peek() not in "<>" else self._redirection()
        if operator in ("<<", "<<-"):
            self.documents.append(word)

    def _skip_documents(self) -> None:
        for end in self.documents:
            found = re.compile(rf"^\t*{re.escape(end)}$", re.M).search(self.text, self.at)
            self.at = found.end() if found else len(self.text)
        self.documents = []

    def _word(self) -> str:
        word = ""
        while self.at < len(self.text) and self._peek() not in ENDS:
            c = self._peek()
            self.at += 1
            if c == "\\":
                word += self._peek()
                self.at += 1
            elif c == "'":
                start = self.at
                self._skip_to("'")
                word += self.text[start:self.at - 1]
            elif c == '"':
                word += self._through('"')
            else:
                self.at -= 1
                word += self._piece()
        if self._peek() == "(" and re.fullmatch(r"\w+\+?=", word):
            self.at += 1
            self.arrays.setdefault(word.rstrip("+="), self._array())
        return word or GAP

    def _array(self) -> list[str]:
        words = []
        while self.at < len(self.text) and self._peek() != ")":
            if self._peek() in BLANK + "\n;&|<>(":
                self.at += 1
            elif self._peek() == "#":
                self._skip_to("\n")
            else:
                words.append(self._word())
        self.at += 1
        return words

    def _through(self, end: str) -> str:
        """The text up to `end` and past it, which holds no commands but those of expansions."""
        text = ""
        while self.at < len(self.text) and not self.text.startswith(end, self.at):
            if self._peek() == '"' and end != '"':
                self.at += 1
                text += self._through('"')
            else:
                text += self._piece()
        self.at += len(end)
        return text

    def _piece(self) -> str:
        """A character, or an expansion, whose commands are found."""
        c = self._peek()
        self.at += 1
        if c == "\\":
            self.at += 1
            return self.text[self.at - 1:self.at]
        if c == "`":
            start = self.at
            self._skip_to("`")
            self.found += Commands(self.text[start:self.at - 1]).found
            return GAP
        if c != "$":
            return c
        if self._peek(2) == "((":
            self._through("))")
        elif self._peek() == "(":
            self.at += 1
            self._list()
        elif self._peek() == "{":
            array = re.match(r"\{(\w+)\[@\]\}", self.text[self.at:])
            self.at += 1
            self._through("}")
            if array:
                return f"{GAP}{array.group(1)}"
        elif re.match(r"\w|[@*#?$!-]", self._peek() or " "):
            self.at += len(re.match(r"\w+|.", self.text[self.at:]).group())
        return GAP


def programs(text: str) -> set[str]:
    """The names of the programs that a script starts or looks for; not those that variables name."""
    script = Commands(text)
    started: set[str] = set()
    for words in script.found:
        started |= of_command(words, script.arrays)
    return started - script.functions


def of_command(words: list[str], arrays: dict[str, list[str]]) -> set[str]:
    words = list(words)
    while words and re.match(r"\w+\+?=", words[0]):
        words.pop(0)
    if not words:
        return set()
    name, rest = words[0].rsplit("/", 1)[-1] if words[0].startswith("/") else words[0], words[1:]
    if name.startswith(GAP):
        array = arrays.get(name[1:])
        return of_command(array + rest, arrays) if array else of_command(rest, arrays) if name[1:] in arrays else set()
    found: set[str] = set()
    if name in ("bash", "sh") and "-c" in rest[:2]:
        found |= programs(rest[rest.index("-c") + 1].replace(GAP, ""))
    if name == "trap" and rest:
        return programs(rest[0].replace(GAP, ""))
    if name == "find":
        found |= {rest[i + 1] for i, word in enumerate(rest[:-1]) if word in ("-exec", "-execdir", "-ok")}
    if name in PREFIXES:
        takes, index = PREFIXES[name], 0
        while index < len(rest) and (re.match(r"-|\w+=|\d", rest[index]) or (name == "chroot" and index == 0)):
            index += 2 if re.fullmatch(rf"-[{takes or '-'}]", rest[index]) else 1
        found |= of_command(rest[index:], arrays)
    if name not in BUILTINS and name not in ("command", "exec") and re.fullmatch(r"[a-z][\w+.-]*", name):
        found.add(name)
    return found
