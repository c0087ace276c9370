"""Makes render_pb2.py and settings.py of render.proto, with protoc: generate.py FOLDER_OF_PROTO PACKAGE_FOLDER

settings.py has a dataclass for each message that a program fills in, with the words of its declarations and comments.
"""
import importlib.util
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from typing import Any

PROTO = "candela/v1/render.proto"
ROOTS = ("Settings", "Camera", "Sphere", "ExposureState")
HEAD = '''"""What a frame is rendered with, as dataclasses: a field that is None takes its default. Made of render.proto."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Sequence

'''


def _load(path: pathlib.Path) -> Any:
    spec = importlib.util.spec_from_file_location("render_pb2", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def word(value: str, enum: str) -> str:
    """The word of an enum's value: CURVE_ACES_HILL of Curve is "aces-hill"."""
    prefix = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", enum).upper() + "_"
    return value.removeprefix(prefix).lower().replace("_", "-")


def _number(value: float) -> str:
    return f"2^{value.hex().partition('p')[2].lstrip('+')}" if value.hex().startswith("0x1.0000000000000p") and (
        value > 1e9 or value < 1e-9) else f"{value:g}"


class _Dataclasses:
    def __init__(self, file: Any, comments: dict[tuple[str, str], str], pb2: Any) -> None:
        self._file, self._comments, self._pb2 = file, comments, pb2
        self._made: dict[str, str] = {}

    def text(self) -> str:
        for root in ROOTS:
            self._make(self._file.message_types_by_name[root])
        return HEAD + "\n".join(self._made.values())

    def _make(self, message: Any) -> None:
        if message.name in self._made:
            return
        fields = message.fields
        for field in fields:
            if field.message_type is not None:
                self._make(field.message_type)
        about = self._comments.get((message.name, ""), "") or f"{message.name}."
        about = [textwrap.fill(about, 118, initial_indent='    """', subsequent_indent="    "), ""]
        about += [textwrap.fill(f"{field.name}: {self._about(message, field)}".rstrip(": "), 118, initial_indent="    ",
                                subsequent_indent="        ") for field in fields]
        lines = ["@dataclass(kw_only=True)", f"class {message.name}:", *about, '    """', ""]
        lines += [f"    {field.name}: {self._type(field)} | None = None" for field in fields]
        self._made[message.name] = "\n".join(lines) + "\n\n"

    def _type(self, field: Any) -> str:
        if field.enum_type is not None:
            names = list(field.GetOptions().Extensions[self._pb2.setting].words) or [
                word(value.name, field.enum_type.name) for value in field.enum_type.values if value.number > 0]
            return f"Literal[{', '.join(repr(name) for name in names)}]"
        if field.message_type is not None:
            one = f"{field.message_type.name} | dict[str, object]"
        else:
            one = {field.CPPTYPE_DOUBLE: "float", field.CPPTYPE_FLOAT: "float", field.CPPTYPE_BOOL: "bool"}.get(
                field.cpp_type, "int")
            if field.type in (field.TYPE_STRING, field.TYPE_BYTES):
                one = "str" if field.type == field.TYPE_STRING else "bytes"
        return f"Sequence[{one}]" if field.label == field.LABEL_REPEATED else one

    def _about(self, message: Any, field: Any) -> str:
        setting = field.GetOptions().Extensions[self._pb2.setting]
        words = [f"{setting.help}."] if setting.help else []
        if setting.max > setting.min:
            words.append(f"{_number(setting.min)} .. {_number(setting.max)}{' ' + setting.unit if setting.unit else ''}.")
        if setting.HasField("default") or setting.default_word:
            words.append(f"Default: {setting.default_word or _number(setting.default)}.")
        comment = self._comments.get((message.name, field.name), "")
        return " ".join(words + ([comment] if comment else []))


def _comments(files: Any) -> dict[tuple[str, str], str]:
    """The comments of messages and of their fields, by both names."""
    found = {}
    for file in files.file:
        if file.name != PROTO:
            continue
        for place in file.source_code_info.location:
            text = " ".join((place.leading_comments + place.trailing_comments).split()).replace("\\", "").replace('"', "'")
            message, names = None, []
            path = list(place.path)
            kinds = file.message_type
            while len(path) >= 2 and path[0] in (3, 4):  # message_type of a file, nested_type of a message
                message = kinds[path[1]]
                kinds, path = message.nested_type, path[2:]
                if path[:1] != [3]:
                    break
            if message is None or not text:
                continue
            if not path:
                names = [message.name, ""]
            elif path[0] == 2 and len(path) == 2:
                names = [message.name, message.field[path[1]].name]
            if names and text and not text.startswith("----"):
                found[names[0], names[1]] = text[0].upper() + text[1:] + ("" if text.endswith(".") else ".")
    return found


def generate(protos: pathlib.Path, package: pathlib.Path) -> None:
    from google.protobuf import descriptor_pb2

    with tempfile.TemporaryDirectory() as scratch:
        made = pathlib.Path(scratch)
        subprocess.run(["protoc", f"-I{protos}", f"--python_out={made}", f"--pyi_out={made}", "--include_source_info",
                        f"--descriptor_set_out={made / 'set'}", PROTO], check=True)
        for suffix in ("py", "pyi"):
            shutil.copy(made / f"candela/v1/render_pb2.{suffix}", package / f"render_pb2.{suffix}")
        pb2 = _load(package / "render_pb2.py")
        files = descriptor_pb2.FileDescriptorSet.FromString((made / "set").read_bytes())
    (package / "settings.py").write_text(_Dataclasses(pb2.DESCRIPTOR, _comments(files), pb2).text())


if __name__ == "__main__":
    generate(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
