#!/usr/bin/env python3
"""Runs every block of docs/recipes.md on small data, in the page's order: recipes_test.py FOLDER_OF_BINARIES

Looks at what they made. A block that needs ffmpeg or node is left out with a word where that is missing; if any is, the test
ends as skipped.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/net"))
from scenes import write_png  # noqa: E402

PAGE = ROOT / "docs/recipes.md"
NEEDS = {"ffmpeg": re.compile(r"\bffmpeg\b|\.(mp4|mov|mkv|webm)\b|extract_review"), "node": re.compile(r"^node ")}
SERVER = "node upload.mjs 8080\n"
# What the blocks make, and what ffprobe says of films.
FILMS = {"review.mp4": "h264", "review-hdr.mp4": "hevc", "review-sdr.mp4": "h264", "review.mov": "prores", "lit.mp4": "h264",
         "again.mp4": "h264", "own.webm": "vp9", "published/review.mp4": "h264"}
FILES = ["shot.json", "out/0004.png", "out/0006.png", "thumbs/a.jpg", "thumbs/b.jpg", "thumbs.json", "library.jpg",
         "shot.png", "sdr.jpg", "agx.jpg", "b-pq.png", "b-hlg.avif", "both.jpg", "aces.jpg", "pano.jpg", "pano.ktx2", "sh.json", "pano.png", "published/thumbnail.jpg"]


def run(*command: str) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def blocks() -> list[str]:
    """The indented lines of the page, without their indentation."""
    found = re.findall(r"(?:^    \S.*\n(?:^    .*\n)*)", PAGE.read_text(), re.M)
    return [re.sub(r"^    ", "", block, flags=re.M) for block in found]


def make_data() -> None:
    """A shot of six frames of which one is missing, a library with a broken picture, a panorama."""
    run("candela", "sample", "--sequence", "shot", "--frames", "6", "--size", "96x64", "-q")
    for number in range(6):
        pathlib.Path(f"shot/{number:04d}.exr").rename(f"shot/shot.{number + 1:04d}.exr")
    pathlib.Path("library").mkdir()
    pathlib.Path("hdri").mkdir()
    shutil.copy("shot/shot.0001.exr", "library/a.exr")
    run("candela", "sample", "library/b.exr", "--size", "640x360", "-q")
    pathlib.Path("shot/shot.0004.exr").unlink()
    run("candela", "sample", "--panorama", "hdri/pano.exr", "--size", "128x64", "-q")
    pathlib.Path("hdr").mkdir()
    write_png(pathlib.Path("hdr/pq.png"), 16, 8, [400 * i for i in range(128)] * 3, (9, 16, 0, 1))
    shutil.copytree(ROOT / "docs/recipes", ".", dirs_exist_ok=True)


def post(port: int, body: bytes) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", body, timeout=60) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def upload() -> None:
    """The server answers with a JPEG, or says why there is none, and goes on."""
    server = subprocess.Popen(["node", "upload.mjs", "0"], stdout=subprocess.PIPE, text=True)
    try:
        port = int(server.stdout.readline().split()[-1])
        picture = pathlib.Path("library/b.exr").read_bytes()
        for _ in range(2):
            status, body = post(port, picture)
            expect(status == 200 and body.startswith(b"\xff\xd8\xff"), f"upload: {status} {body[:200]!r}")
            status, body = post(port, picture[:5000])
            expect(status == 422 and body.startswith(b"candela: error: standard input"), f"upload of half a picture: {status} {body!r}")
    finally:
        server.terminate()
        server.wait()


def expect(true: object, message: str) -> None:
    if not true:
        sys.exit(f"failed: {message}")


def check_films() -> None:
    for film, codec in FILMS.items():
        said = run("ffprobe", "-v", "error", "-count_frames", "-of", "json", "-show_streams", film)
        stream = json.loads(said)["streams"][0]
        facts = [stream.get(key) for key in ("codec_name", "nb_read_frames", "r_frame_rate", "color_space", "width")]
        matrix = "bt2020nc" if "hdr" in film else "bt709"
        expect(facts == [codec, "6", "24/1", matrix, 96], f"{film} is {facts}")
    published = json.loads(pathlib.Path("published.json").read_text())
    expect(published["frameStart"] == 1 and published["frameEnd"] == 6 and len(published["representations"]) == 2,
           f"the extractor says {published}")


def main() -> None:
    path = f"{pathlib.Path(sys.argv[1]).resolve()}:{os.environ['PATH']}"
    os.environ.update(PATH=path)
    missing = {name for name in NEEDS if not shutil.which(name)}
    with tempfile.TemporaryDirectory(prefix="candela-recipes-") as scratch, contextlib.chdir(scratch):
        make_data()
        left_out = 0
        for block in blocks():
            lacks = sorted(name for name in missing if NEEDS[name].search(block))
            if lacks:
                print(f"left out, because there is no {' and no '.join(lacks)}: {block.splitlines()[0]}")
                left_out += 1
            elif block == SERVER:
                upload()
            else:
                print(block, end="", flush=True)
                done = subprocess.run(block, shell=True, stdout=subprocess.PIPE, text=True, check=False)
                expect(done.returncode == 0, f"this ended with {done.returncode}:\n{block}")
                if "extract_review" in block:
                    pathlib.Path("published.json").write_text(done.stdout)
        if "ffmpeg" not in missing:
            check_films()
        for file in FILES:
            if not (file.startswith("published") and "ffmpeg" in missing):
                expect(pathlib.Path(file).is_file(), f"there is no {file}")
    sys.exit(77 if left_out else 0)


main()
