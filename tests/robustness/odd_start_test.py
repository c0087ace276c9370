"""candelad's start with odd files, addresses and limits: it starts and serves, or ends at once with one line and its code."""
import os
import pathlib
import re
import resource
import socket
import subprocess
import tempfile
import time

os.environ["GRPC_ENABLE_FORK_SUPPORT"] = "false"  # a child that only sets limits and starts another program needs none
import harness  # noqa: E402
from harness import Daemon, binary, expect, report  # noqa: E402

USAGE, FAILED = 2, 1
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="candela-odd-"))
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("CANDELA")}
wrong: list[str] = []


def limit(what: int, value: int):
    return lambda: resource.setrlimit(what, (value, value))


def ends(what: str, code: int, *options: str, words: str = "", preexec=None, env=None) -> str:
    """It ends with `code` and one line, which holds `words`. Returns what it says."""
    begin = time.monotonic()
    try:
        done = subprocess.run([binary("candelad"), *options], capture_output=True, text=True, errors="replace", timeout=20,
                              preexec_fn=preexec, env=ENVIRONMENT | (env or {}))
        got, text = done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        got, text = None, "it goes on"
    own = [line for line in text.splitlines() if line.startswith("candelad: ")]
    report(case=what, code=got, seconds=round(time.monotonic() - begin, 1), words=text.strip()[-150:])
    if got != code or len(own) != 1 or text.count("\n") != 1 or words not in text:
        wrong.append(f"{what}: code {got} and {text[:200]!r}; it must be {code} and one line with {words!r}")
    return text


def serves(what: str, *options: str, preexec=None, env=None, listen: str = "", log_is_null: bool = False) -> None:
    """It starts, renders and ends with 0."""
    null = subprocess.DEVNULL if log_is_null else None
    daemon = Daemon(*options, preexec=preexec, env=env, listen=listen, stderr=null, wait=20, metrics=False)
    answer = harness.render(daemon.address) if daemon.listening else ("it did not start", "")
    code = daemon.stop(20)
    report(case=what, answer=answer, code=code)
    if answer[0] != "OK" or code != 0:
        wrong.append(f"{what}: {answer}, exit code {code}, {daemon.words()[-200:]!r}")
    daemon.__exit__()


def config(text: bytes) -> str:
    file = FOLDER / f"{len(list(FOLDER.iterdir()))}.conf"
    file.write_bytes(text)
    return str(file)


def new_folder() -> pathlib.Path:
    folder = FOLDER / f"folder{len(list(FOLDER.iterdir()))}"
    folder.mkdir()
    return folder


def files() -> None:
    fifo = str(FOLDER / "fifo")
    os.mkfifo(fifo)
    folder = str(FOLDER)
    for odd in (fifo, "/dev/zero", folder, f"{folder}/none"):
        ends(f"--config {odd}", USAGE, "--config", odd, words="--config")
        ends(f"--resume-keys {odd}", FAILED, "--resume-keys", odd, words="resume-keys")
        ends(f"--token-file {odd}", FAILED, "--token-file", odd, words="token-file")
        ends(f"--tls-cert {odd}", FAILED, "--tls-cert", odd, "--tls-key", odd, words="tls-cert")
    for what, text, words in (("a key twice", b"max-calls = 3\nmax-calls = 4\n", "line 1"),
                              ("a section", b"[x]\nmax-calls = 3\n", "section"), ("a key that is unknown", b"nonsense = 3\n", "nonsense"),
                              ("NUL", b"\0" * 1000, ""), ("a line of 1 MiB", b"max-calls = " + b"9" * (1 << 20), ""),
                              ("2 MiB", b"# x\n" * (1 << 19), "limit"),
                              ("a byte order mark", b"\xef\xbb\xbfmax-calls = 3\n", "max-calls"),
                              ("a time that is no number", b"idle-timeout = nan\n", "nan"),
                              ("an endless time", b"drain-timeout = inf\n", "inf")):
        ends(f"a configuration with {what}", USAGE, "--config", config(text), words=words)
    for option in ("--idle-timeout", "--resume-ttl"):
        for time_ in ("nan", "inf", "-inf", "1e400s"):
            ends(f"{option} {time_}", USAGE, f"{option}={time_}", words=time_)
    for number in ("-1", "1.5", "", "9" * 30):
        ends(f"--max-calls={number}", USAGE, f"--max-calls={number}", words="max-calls")
    serves("an environment of nonsense", env={"HOME": "", "LANG": "xx", "LC_ALL": "zz", "TMPDIR": "/none"})
    serves("a configuration with lines of CR and LF", "--config", config(b"max-calls = 3\r\n\r\n# x\r\n"))


def drivers_cache() -> None:
    """The cache of Mesa, which keeps compiled shaders."""
    for odd in ("/proc/none", str(FOLDER / "file")):
        serves(f"the driver's cache is {odd}", env={"MESA_SHADER_CACHE_DIR": odd, "XDG_CACHE_HOME": odd})
    cache = new_folder()
    environment = {"MESA_SHADER_CACHE_DIR": str(cache), "XDG_CACHE_HOME": str(cache)}
    serves("the driver's cache is empty", "--executor", "device", env=environment)
    kept = [file for file in cache.rglob("*") if file.is_file()]
    expect(kept, "the driver keeps nothing, so its cache was not tested")
    for file in kept:
        file.write_bytes(os.urandom(file.stat().st_size))
    serves(f"the driver's cache is garbage, all {len(kept)} files of it", "--executor", "device", env=environment)


def addresses() -> None:
    ends("port 70000", USAGE, "--listen", "127.0.0.1:70000", words="70000")
    port = harness.free_port()
    ends("a port twice", USAGE, "--listen", f"127.0.0.1:{port},127.0.0.1:{port}", words="twice")
    ends("metrics on the port of gRPC", USAGE, "--listen", f"127.0.0.1:{port}", "--metrics", f"127.0.0.1:{port}", words="metrics")
    ends("a host that is not this machine", FAILED, "--listen", "192.0.2.1:50051", "--insecure", words="192.0.2.1")
    ends("a name that nobody has", FAILED, "--listen", "nobody.invalid:50051", "--insecure", words="nobody.invalid")
    ends("a unix path of 200 letters", FAILED, "--listen", f"unix:{FOLDER}/{'a' * 200}", words="107")
    loop = FOLDER / "loop.sock"
    loop.symlink_to(loop)
    ends("a unix path that is a loop", FAILED, "--listen", f"unix:{loop}", words="is not a socket")
    stale = str(FOLDER / "stale.sock")
    with socket.socket(socket.AF_UNIX) as left_over:
        left_over.bind(stale)
    serves("a socket that a dead process left", listen=f"unix:{stale}")
    serves("IPv6", listen=f"[::1]:{harness.free_port()}") if socket.has_ipv6 and has_ipv6_loopback() else None
    serves("a name", listen=f"localhost:{harness.free_port()}")


def has_ipv6_loopback() -> bool:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
        return True
    except OSError:
        return False


def limits() -> None:
    for mib in (128, 256, 512, 1024, 1536):
        said = ends(f"ulimit -v {mib} MiB", FAILED, "--listen", "127.0.0.1:0", words=f"ulimit -v allows {mib} MiB",
                    preexec=limit(resource.RLIMIT_AS, mib << 20))
    needed_mib = int(re.search(r"needs (\d+) MiB", said)[1])
    serves("ulimit -v as the message says", preexec=limit(resource.RLIMIT_AS, needed_mib << 20))
    for files_ in (8, 16, 24, 32):
        ends(f"ulimit -n {files_}", FAILED, "--listen", "127.0.0.1:0", preexec=limit(resource.RLIMIT_NOFILE, files_))
    serves("ulimit -n 64", preexec=limit(resource.RLIMIT_NOFILE, 64))
    for kib in (64, 128):
        serves(f"ulimit -s {kib}", preexec=limit(resource.RLIMIT_STACK, kib << 10))
    serves("ulimit -f 0", preexec=limit(resource.RLIMIT_FSIZE, 0), log_is_null=True)


files()
drivers_cache()
addresses()
limits()
expect(not wrong, "\n".join(wrong))
