"""The test of deploy/kube.yaml with podman: a pod with candelad and its proxy, and tokens."""
import pathlib
import shutil
import subprocess
import time

import podman
from podman import attempt, expect, wait_until


def kube_play_brings_it_up(folder: pathlib.Path, version: str) -> None:
    """Runs deploy/kube.yaml. podman 4.3 does not fill the Secret's volume, so the test fills it first."""
    text = (podman.ROOT / "deploy/kube.yaml").read_text()
    image = f"image: localhost/candela:{version}"
    expect(text.count(image) == 2, f"deploy/kube.yaml does not have '{image}' twice")
    manifest = folder / "kube.yaml"
    manifest.write_text(text.replace(image, f"image: {podman.IMAGE}"))

    def down() -> None:
        attempt("podman", "kube", "down", manifest)
        attempt("podman", "volume", "rm", "--force", "candela", "candela-tmp", "candela-proxy", "candela-socket")

    def inside(*command: str) -> subprocess.CompletedProcess[str]:
        """Runs the command in the pod, beside candelad; the server is the pod's own front."""
        return attempt("podman", "exec", "--workdir=/tmp", "--env=CANDELA_SERVER=127.0.0.1:50051", "candela-pod-0-candelad",
                       "candela", *command)

    down()  # remove what a killed test left behind
    try:
        podman.podman("volume", "create", "candela")
        secret = pathlib.Path(podman.podman("volume", "inspect", "--format", "{{.Mountpoint}}", "candela"))
        for name, words in (("resume-keys", podman.KEYS), ("tokens", "a-token-of-the-kube-test\n")):
            (secret / name).write_text(words)
            (secret / name).chmod(0o400)
            shutil.chown(secret / name, 65532, 65532)
        podman.podman("kube", "play", manifest)
        wait_until(lambda: inside("health").returncode == 0, "the pod serves",
                   lambda: attempt("podman", "logs", "candela-pod-0-candelad").stderr
                   + attempt("podman", "logs", "candela-pod-0-proxy").stderr)
        expect(inside("sample", "a.exr", "--size", "320x180").returncode == 0, "no sample")
        refused = inside("render", "a.exr", "a.png")
        expect(refused.returncode == 4 and "token" in refused.stderr, f"a call without a token: {refused}")
        token = ("--token-file", "/etc/candela/secret/tokens")
        for words in (("info", *token), ("render", "a.exr", "a.png", *token)):
            done = inside(*words)
            expect(done.returncode == 0, f"{words}: {done.stderr}")
        stopped = time.monotonic()
        podman.podman("pod", "stop", "--time=60", "candela-pod-0")
        codes = [podman.podman("inspect", "--format", "{{.State.ExitCode}}", f"candela-pod-0-{name}") for name in ("candelad", "proxy")]
        expect(codes == ["0", "0"], f"candelad and the proxy ended with {codes} after {time.monotonic() - stopped:.0f} s")
    finally:
        down()
