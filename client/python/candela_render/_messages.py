"""Dataclasses of settings.py become messages of the contract."""
from __future__ import annotations

import dataclasses
import re
from typing import Any

from . import render_pb2 as pb
from . import settings as declared
from ._baked_view import BakedView
from ._error import invalid
from .settings import Settings


def _word(value: str, enum: str) -> str:
    prefix = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", enum).upper() + "_"
    return value.removeprefix(prefix).lower().replace("_", "-")


def enum_number(word: object, enum: Any, name: str) -> Any:
    """The value of an enum by its word, for example "aces-hill". `name` is the field's, for the error."""
    words = {_word(value.name, enum.name): value.number for value in enum.values if value.number > 0}
    if word not in words:
        raise invalid(f"{name} is {word!r}; it is one of {', '.join(words)}")
    return words[str(word)]


def fill(message: Any, value: Any, path: str = "") -> None:
    """Sets the fields of `message` from a dataclass of settings.py, or from a dict of its fields."""
    kind = getattr(declared, message.DESCRIPTOR.name)
    if isinstance(value, dict):
        try:
            value = kind(**value)
        except TypeError:
            names = [field.name for field in dataclasses.fields(kind)]
            wrong = next(key for key in value if key not in names)
            raise invalid(f"there is no {path}{wrong}; {path.rstrip('.') or kind.__name__} has {', '.join(names)}") from None
    if not isinstance(value, kind):
        raise invalid(f"{path.rstrip('.')} is {value!r}; it is a {kind.__name__} or a dict of its fields")
    for field in message.DESCRIPTOR.fields:
        one = getattr(value, field.name, None)
        if one is None:
            continue
        name = path + field.name
        try:
            if field.enum_type is not None:
                setattr(message, field.name, enum_number(one, field.enum_type, name))
            elif field.message_type is not None and field.label == field.LABEL_REPEATED:
                for item in one:
                    fill(getattr(message, field.name).add(), item, f"{name}.")
            elif field.message_type is not None:
                part = getattr(message, field.name)
                part.SetInParent()
                fill(part, one, f"{name}.")
            elif field.label == field.LABEL_REPEATED:
                getattr(message, field.name).extend(one)
            else:
                setting = field.GetOptions().Extensions[pb.setting]
                if setting.max > setting.min and not setting.min <= one <= setting.max:
                    raise invalid(f"{name} is {one:g}; it must be between {setting.min:g} and {setting.max:g}")
                setattr(message, field.name, one)
        except (TypeError, ValueError) as error:
            raise invalid(f"{name} is {one!r}: {error}") from None


def settings_message(settings: Settings | None, changes: dict[str, Any]) -> pb.Settings:
    """`changes` are fields of Settings by name, in place of those of `settings`; and a BakedView as `view`."""
    message = pb.Settings()
    fill(message, settings or Settings())
    changes = dict(changes)
    view = changes.pop("view", None)
    if view is not None:
        if not isinstance(view, BakedView):
            raise invalid(f"view is {view!r}; it is a BakedView, as bake_view() makes it")
        if "curve" in changes or message.curve:
            raise invalid("view is in place of curve; give only one of them")
        message.curve = pb.TONE_CURVE_TABLE
        message.table.CopyFrom(view.table)
        if not message.HasField("exposure"):
            message.exposure.mode = pb.Exposure.MODE_MANUAL
        if not message.HasField("bloom"):
            message.bloom.intensity = 0
    part = pb.Settings()
    fill(part, changes)
    for name in changes:
        message.ClearField(name)
    message.MergeFrom(part)
    return message
