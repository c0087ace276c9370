"""Writes uncompressed OpenEXR files of halves, with the parts, layers and views that no command of Candela writes.

The layout is that of "OpenEXR File Layout" on openexr.com.
"""
import pathlib
import struct

MAGIC, VERSION, MULTI_PART = 20000630, 2, 0x1000
HALF = 1


def attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def strings(words: list[str]) -> bytes:
    return b"".join(struct.pack("<i", len(word)) + word.encode() for word in words)


def header(width: int, height: int, channels: dict, part: dict, several: bool) -> bytes:
    listed = b"".join(name.encode() + b"\0" + struct.pack("<iBxxxii", HALF, 0, 1, 1) for name in sorted(channels)) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    text = attribute("channels", "chlist", listed)
    text += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    text += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    text += attribute("pixelAspectRatio", "float", struct.pack("<f", part.get("aspect", 1)))
    text += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    text += attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    if "views" in part:
        text += attribute("multiView", "stringvector", strings(part["views"]))
    if several:
        text += attribute("name", "string", part["name"].encode())
        text += attribute("type", "string", b"scanlineimage") + attribute("chunkCount", "int", struct.pack("<i", height))
    return text + b"\0"


def write_exr(path: pathlib.Path, width: int, height: int, *parts: dict) -> None:
    """Each part has `channels`, a value of (x, y) for each name, and perhaps `name`, `views` and `aspect`."""
    several = len(parts) > 1
    start = struct.pack("<ii", MAGIC, VERSION | (MULTI_PART if several else 0))
    start += b"".join(header(width, height, part["channels"], part, several) for part in parts) + (b"\0" if several else b"")
    at = len(start) + 8 * height * len(parts)
    offsets, chunks = b"", b""
    for number, part in enumerate(parts):
        for y in range(height):
            row = b"".join(struct.pack(f"<{width}e", *(value(x, y) for x in range(width)))
                           for _, value in sorted(part["channels"].items()))
            offsets += struct.pack("<Q", at + len(chunks))
            chunks += (struct.pack("<i", number) if several else b"") + struct.pack("<ii", y, len(row)) + row
    path.write_bytes(start + offsets + chunks)
