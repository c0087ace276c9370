"""The net's procedural inputs: PFM files that are the same on every machine, byte for byte."""
import array
import json
import pathlib
import struct
import subprocess
import sys
import zlib

NAN, INF, LARGEST_HALF = float("nan"), float("inf"), 65504.0
SEQUENCE_SIZE = "96x54"
SEQUENCE_FRAMES = 12


def write_pfm(path: pathlib.Path, width: int, height: int, pixels: list[float]) -> None:
    """Writes RGB pixels, rows from the top, as a little-endian PFM. Python computes them in doubles, rounded once."""
    rows = [pixels[3 * width * y:3 * width * (y + 1)] for y in range(height)]
    data = array.array("f", [value for row in reversed(rows) for value in row])
    if sys.byteorder == "big":
        data.byteswap()
    path.write_bytes(b"PF\n%d %d\n-1.0\n" % (width, height) + data.tobytes())


def write_png(path: pathlib.Path, width: int, height: int, codes: list[int], cicp: tuple[int, int, int, int]) -> None:
    """R, G, B of 16 bits."""
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = [codes[i:i + 3 * width] for i in range(0, len(codes), 3 * width)]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)) +
                     chunk(b"cICP", bytes(cicp)) +
                     chunk(b"IDAT", zlib.compress(b"".join(b"\0" + struct.pack(f">{len(row)}H", *row) for row in rows))) +
                     chunk(b"IEND", b""))


def noise(count: int, seed: int) -> list[float]:
    """Uniform numbers in [0, 1) from a linear congruential generator."""
    out = []
    for _ in range(count):
        seed = (seed * 6364136223846793005 + 1442695040888963407) % (1 << 64)
        out.append((seed >> 40) / (1 << 24))
    return out


def picture(width: int, height: int, colour) -> tuple[int, int, list[float]]:
    return width, height, [value for y in range(height) for x in range(width) for value in colour(x, y)]


def natural(width: int, height: int, seed: int) -> tuple[int, int, list[float]]:
    """Light over 20 stops, with noise in each component."""
    grain = noise(3 * width * height, seed)
    return width, height, [2.0 ** (-12 + 20 * ((i // 3 % width) / width)) * (0.5 + grain[i])
                           for i in range(len(grain))]


def with_bad_values() -> tuple[int, int, list[float]]:
    width, height, pixels = natural(33, 29, 7)
    for at, value in ((0, NAN), (100, INF), (101, -INF), (500, -3.0), (501, 1e30), (502, -1e30), (1300, 1e-40),
                      (3 * width * height - 1, NAN)):
        pixels[at] = value
    return width, height, pixels


def hard_scenes() -> dict[str, tuple[int, int, list[float]]]:
    return {
        "bad-values": with_bad_values(),
        "black": picture(16, 16, lambda x, y: (0.0, 0.0, 0.0)),
        "black-pixel": picture(1, 1, lambda x, y: (0.0, 0.0, 0.0)),
        "checkerboard": picture(40, 40, lambda x, y: ((x + y) % 2 * LARGEST_HALF,) * 3),
        "dim": picture(19, 7, lambda x, y: (1e-7 * (x + 1), 1e-6, 3e-8 * (y + 1))),
        "firefly": picture(65, 63, lambda x, y: (30000.0, 20.0, 5.0) if (x, y) == (31, 30) else (0.05, 0.05, 0.05)),
        "letterbox": picture(96, 54, lambda x, y: (0.3 + x / 96, 0.2, 4.0 * y / 54) if 8 <= y < 46 else (0.0,) * 3),
        "narrow": natural(3, 257, 11),
        "natural": natural(61, 47, 3),
        "nothing-finite": picture(5, 5, lambda x, y: (NAN, INF, NAN)),
        "saturated": picture(48, 24, lambda x, y: tuple(2.0 ** (y / 2 - 4) if x // 16 == i else -0.01
                                                        for i in range(3))),
        "white-pixel": picture(1, 1, lambda x, y: (1.0, 1.0, 1.0)),
        "wide": natural(4096, 2, 5),
    }


SAMPLES = ("1x1", "64x48", "131x67", "2x333")
LARGE_SAMPLE = "1920x1080"
PANORAMA, LARGE_PANORAMA = "64x32", "512x256"


def many_objects() -> list[dict]:
    """As many spheres as a view may have, of every material, in front of each other and apart."""
    return [{"centre": [i % 8 - 3.5, i // 8 - 3.5, -8.0 - i % 5], "radius": 0.25 + (i % 7) / 16,
             "base_color": [(i % 3) / 2, (i % 5) / 4, (i % 9) / 8], "metallic": (i % 4) / 3,
             "roughness": (i % 6) / 5, "fixed_to_camera": i % 2 == 0} for i in range(64)]


CAMERA_KEYS = [{"time": 0.0, "yaw": 0.0, "pitch": 0.0, "roll": 0.0, "fov": 60.0},
               {"time": 0.1, "yaw": 70.0, "pitch": 20.0, "roll": -5.0, "fov": 40.0},
               {"time": 0.25, "yaw": 100.0, "pitch": -30.0, "roll": 0.0, "fov": 90.0}]


def make(candela: pathlib.Path, folder: pathlib.Path, small: bool) -> list[str]:
    """Writes the scenes, the sequences and the panoramas into `folder`. Returns the file names of the scenes only."""
    def sample(*options: str) -> None:
        subprocess.run([candela, "sample", *options, "-q"], check=True, timeout=120)

    for name, scene in hard_scenes().items():
        write_pfm(folder / f"{name}.pfm", *scene)
    for size in SAMPLES:
        sample(str(folder / f"sample-{size}.pfm"), "--size", size)
    if not small:
        sample(str(folder / f"sample-{LARGE_SAMPLE}.exr"), "--size", LARGE_SAMPLE)
    scenes = sorted(path.name for path in folder.iterdir())

    (folder / "sequence").mkdir()
    sample("--sequence", str(folder / "sequence" / "%04d.pfm"), "--frames", str(SEQUENCE_FRAMES), "--size",
           SEQUENCE_SIZE)
    damaged = folder / "damaged"
    damaged.mkdir()
    for path in sorted((folder / "sequence").iterdir()):
        data = path.read_bytes()
        (damaged / path.name).write_bytes(data[:len(data) // 2] if path.stem in ("0003", "0007") else data)
    cuts = folder / "cuts"
    cuts.mkdir()
    for i, name in enumerate(["natural", "natural", "letterbox", "letterbox", "firefly", "sample-131x67", "natural",
                              "black"]):
        (cuts / f"{i:04d}.pfm").write_bytes((folder / f"{name}.pfm").read_bytes())

    panoramas = folder / "panoramas"
    panoramas.mkdir()
    sample("--panorama", str(panoramas / f"sample-{PANORAMA}.pfm"), "--size", PANORAMA)
    if not small:
        sample("--panorama", str(panoramas / f"sample-{LARGE_PANORAMA}.exr"), "--size", LARGE_PANORAMA)
    write_pfm(panoramas / "noise-61x31.pfm", *natural(61, 31, 13))
    (panoramas / "objects.json").write_text(json.dumps({"objects": many_objects()}), encoding="utf-8")
    (panoramas / "keys.json").write_text(json.dumps({"keys": CAMERA_KEYS}), encoding="utf-8")
    return scenes
