"""What a PNG holds, however it was filtered and deflated."""
import struct
import zlib

SAMPLES = {2: 3, 6: 4}  # RGB, RGBA


def comparable(data: bytes) -> bytes:
    """What counts of an image: of a PNG its parts, of anything else all."""
    return b"".join(png_parts(data)) if data.startswith(b"\x89PNG") else data


def png_parts(data: bytes) -> tuple[bytes, bytes]:
    """All chunks but the pixels' own, and the bytes of the pixels. For RGB and RGBA that is not interlaced."""
    at, others, packed = 8, b"", b""
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + length]
        at += 12 + length
        if kind == b"IDAT":
            packed += body
        else:
            others += kind + body
    width, height, depth, color, *rest = struct.unpack(">IIBBBBB", others[4:17])
    if color not in SAMPLES or rest != [0, 0, 0]:
        raise ValueError(f"colour type {color}, or interlaced")
    size = SAMPLES[color] * depth // 8
    raw, stride = zlib.decompress(packed), size * width
    above, pixels = bytearray(stride), bytearray()
    for start in range(0, height * (stride + 1), stride + 1):
        row = bytearray(raw[start + 1:start + 1 + stride])
        unfilter(raw[start], row, above, size)
        pixels += row
        above = row
    return others, bytes(pixels)


def unfilter(kind: int, row: bytearray, above: bytearray, size: int) -> None:
    """In place; `size` is the number of bytes of a pixel."""
    if kind == 1:
        for x in range(size, len(row)):
            row[x] = (row[x] + row[x - size]) & 255
    elif kind == 2:
        row[:] = bytes((value + up) & 255 for value, up in zip(row, above))
    elif kind == 3:
        for x in range(len(row)):
            row[x] = (row[x] + ((row[x - size] if x >= size else 0) + above[x]) // 2) & 255
    elif kind == 4:
        left, corner = bytearray(size), bytearray(size)
        for x in range(len(row)):
            a, b, c = left[x % size], above[x], corner[x % size]
            pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            row[x] = (row[x] + (a if pa <= pb and pa <= pc else b if pb <= pc else c)) & 255
            left[x % size], corner[x % size] = row[x], b
