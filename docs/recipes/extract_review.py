#!/usr/bin/env python3
"""What an AYON extractor does with a published render: a review film and a thumbnail, as representations.

extract_review.py FRAMES FOLDER [--fps N]. Prints what a pipeline stores. Ends with candela's exit code (docs/failures.md).
"""
import argparse
import json
import math
import pathlib
import subprocess
import sys


def candela(*words: str) -> list[dict]:
    """The lines of --json; the last one says why a command failed."""
    done = subprocess.run(["candela", *words, "--json", "-", "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    if done.returncode != 0:
        failure = lines[-1]["error"]
        print(f"{failure['kind']}: {failure['message']}", file=sys.stderr)
        sys.exit(failure["code"])
    return lines


def extract(frames: str, folder: pathlib.Path, fps: str) -> dict:
    film, thumbnail = folder / "review.mp4", folder / "thumbnail.jpg"
    *shots, summary = candela("stream", frames, str(film), "--fps", fps, "--missing", "hold", "--skip-bad")
    good = [shot for shot in shots if "exposure" in shot]
    middle = good[len(good) // 2]
    # The thumbnail has the exposure that its frame has in the film.
    candela("render", middle["input"], str(thumbnail), "--exposure", str(math.log2(middle["exposure"])),
            "--max-size", "480")
    return {"representations": [{"name": "review", "ext": "mp4", "files": film.name, "tags": ["review"]},
                                {"name": "thumbnail", "ext": "jpg", "files": thumbnail.name, "thumbnail": True}],
            "frameStart": shots[0]["frame"], "frameEnd": shots[-1]["frame"], "fps": summary["summary"]["fps"],
            "broken": {shot["frame"]: shot["error"] for shot in shots if "error" in shot}}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("frames")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--fps", default="24")
    given = parser.parse_args()
    print(json.dumps(extract(given.frames, given.folder, given.fps), indent=1))
