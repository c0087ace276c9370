#!/usr/bin/env python3
"""Tests of the container image. `container_test.py CLAIM BIN VERSION` runs one test. BIN contains this tree's candela and
candelad, built for the host.

Each claim is a function below. CLAIM is its name in CamelCase: TheImageBuilds runs the_image_builds, which makes the image
for the other tests.
"""
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import images
import pod
import podman
from images import drivers_of, expect_libraries, in_image
from podman import Container, attempt, containers, expect, run, wait_until
from sessions import Sessions, digests, expect_same, make_film

BASE_LIMIT_MB = 280  # the image's size in addition to its base's
CANDELA = CANDELAD = VERSION = ""
FOLDER = pathlib.Path()


def the_image_builds() -> None:
    begin = time.monotonic()
    # Nightly compiles the programs in the container, as users do.
    podman.build_image(VERSION, None if "CANDELA_TEST_COMPILES_IN_CONTAINER" in os.environ else pathlib.Path(CANDELA).parent)
    print(f"built in {time.monotonic() - begin:.0f} s")


def image_field(field: str) -> str:
    return podman.podman("image", "inspect", "--format", "{{" + field + "}}", podman.IMAGE)


def the_image_is_small_and_holds_what_runs_and_says_what_it_is() -> None:
    base = int(podman.podman("image", "inspect", "--format", "{{.Size}}", podman.BASE))
    added = (int(image_field(".Size")) - base) / 1e6
    print(f"{added:.0f} MB beyond a base of {base / 1e6:.0f} MB")
    expect(added <= BASE_LIMIT_MB, f"the image adds {added:.0f} MB to its base; {BASE_LIMIT_MB} MB is the limit")
    expect(image_field(".Config.User") == "65532:65532", f"it runs as {image_field('.Config.User')}")
    label = image_field('index .Config.Labels "org.opencontainers.image.version"')
    ran = in_image("candelad", "--version")
    expect(ran == f"candelad {VERSION}" and label == VERSION, f"the label says {label}, the daemon {ran}, the tree {VERSION}")
    special = in_image("find", "/", "-xdev", "-perm", "/6000", "!", "-type", "l")
    expect(special == "", f"files run as their owner:\n{special}")
    writable = in_image("find", "/", "-xdev", "-perm", "-o+w", "!", "-type", "l", "!", "-type", "c", "!", "-path", "/tmp",
                        "!", "-path", "/var/tmp", "!", "-path", "/run/lock", "!", "-path", "/proc/*", "!", "-path", "/dev/*")
    expect(writable == "", f"anyone may write:\n{writable}")
    drivers = drivers_of(podman.IMAGE)
    expect([pathlib.Path(driver).name for driver in drivers] == ["libvulkan_lvp.so"], f"not lavapipe alone: {drivers}")
    expect_libraries(podman.IMAGE, "/usr/bin/candela", "/usr/bin/candelad", *drivers)


def the_gpu_image_has_mesas_drivers_and_still_runs_without_a_gpu() -> None:
    images.check_gpu_image(VERSION)


def the_host_image_has_no_vulkan_and_is_half_as_large() -> None:
    images.check_host_image(VERSION)


def the_sbom_lists_every_package() -> None:
    sbom = json.loads(in_image("cat", "/usr/share/candela/sbom.spdx.json"))
    expect(sbom["spdxVersion"] == "SPDX-2.3" and sbom["dataLicense"] == "CC0-1.0", "not SPDX 2.3")
    installed = set(in_image("dpkg-query", "--show", "--showformat", "${db:Status-Status} ${Package} ${Version}\n").splitlines())
    installed = {line.removeprefix("installed ") for line in installed if line.startswith("installed ")}
    ids = {package["SPDXID"]: f"{package['name']} {package['versionInfo']}" for package in sbom["packages"]}
    expect(len(ids) == len(sbom["packages"]), "two packages have one SPDXID")
    related = sbom["relationships"]
    inside = {ids[relation["relatedSpdxElement"]] for relation in related if relation["relationshipType"] == "DEPENDS_ON"}
    expect(inside == installed, f"in one of image and SBOM only: {sorted(inside ^ installed)}")
    described = [ids[relation["relatedSpdxElement"]] for relation in related if relation["relationshipType"] == "DESCRIBES"]
    expect(described == [f"candela {VERSION}"], f"it describes {described}")
    texts = {text["licenseId"] for text in sbom["hasExtractedLicensingInfos"]}
    declared = {license_id for package in sbom["packages"] for license_id in package["licenseDeclared"].split(" AND ")}
    expect({license_id for license_id in declared if license_id.startswith("LicenseRef")} == texts, "a licence has no text")
    expect("" not in declared, "a package has no licence")
    lines = in_image("cat", "/usr/share/candela/licenses.txt").splitlines()
    expect(len(lines) == len(ids), f"{len(lines)} lines of licences for {len(ids)} packages")
    print(f"{len(installed)} packages in the image, {len(ids) - len(installed) - 1} more built in; {len(declared)} licences")


def it_does_not_start_in_the_open_or_without_a_driver_and_says_why() -> None:
    def ends(code: int, says: str, *options: str, arguments: tuple[str, ...] = ()) -> None:
        ended = attempt("podman", "run", "--rm", "--timeout=60", "--network=none", *podman.AS_SHIPPED, *options, podman.IMAGE, *arguments)
        lines = [line for line in ended.stderr.splitlines() if line.startswith(("candelad: ", "candela-front: "))]
        expect(ended.returncode == code and len(lines) == 1 and says in lines[0],
               f"it ended with {ended.returncode}, not {code}, or did not say '{says}':\n{ended.stdout}{ended.stderr}")
        print(lines[0])

    ends(2, "PROXY_INSECURE")
    ends(2, "cannot read /nowhere.crt", "--env=PROXY_CERT=/nowhere.crt")
    ends(1, "driver", "--env=PROXY_INSECURE=true", "--env=VK_DRIVER_FILES=/nowhere.json")


def it_renders_and_streams_the_hosts_bits() -> None:
    with containers(Container()) as (candelad,):
        run(CANDELA, "health", "--server", candelad.address)
        podman.podman("healthcheck", "run", candelad.id)
        expect(podman.get(candelad.metrics_port, "/livez")[0] == 200, "/livez")
        expect(candelad.metric("candela_serving") == 1, "candela_serving")
        expect(podman.podman("exec", candelad.id, "id", "-u") == "65532", "it runs as another user")
        threads = podman.podman("exec", candelad.id, "sh", "-c", "grep -l llvmpipe- /proc/[0-9]*/task/*/comm | wc -l")
        expect(threads == "1", f"lavapipe has {threads} threads on 1 CPU")
        run(CANDELA, "sample", FOLDER / "scene.exr", "--size", "1280x720")
        server = ("--server", candelad.address)
        run(CANDELA, "render", FOLDER / "scene.exr", FOLDER / "here.png", "--bits", "16")
        run(CANDELA, "render", FOLDER / "scene.exr", FOLDER / "there.png", "--bits", "16", *server)
        expect((FOLDER / "here.png").read_bytes() == (FOLDER / "there.png").read_bytes(), "an image is not the host's")
        run(CANDELA, "sample", "--sequence", FOLDER / "in", "--size", "640x360", "--frames", "24")
        for name, options in (("plain", ()), ("ahead", ("--lookahead", "3", "--detect-cuts"))):
            run(CANDELA, "stream", FOLDER / "in", FOLDER / f"{name}-here", *options)
            run(CANDELA, "stream", FOLDER / "in", FOLDER / f"{name}-there", *options, *server)
            expect_same(FOLDER / f"{name}-there", digests(FOLDER / f"{name}-here"))
        rendered = candelad.metric('candela_frames_total{result="ok"}')
        expect(rendered >= 49, f"candela_frames_total says {rendered}")
        # The command in the container renders too, under the same limits.
        podman.podman("exec", candelad.id, "sh", "-c", "candela sample s.exr --size 64x64 && candela render s.exr s.png"
                      " --server unix:/tmp/candelad.sock")


def it_shares_memory_with_its_host_and_with_other_containers() -> None:
    shared = FOLDER / "shared"
    shared.mkdir()
    shutil.chown(shared, 65532, 65532)
    volume = f"--volume={shared}:/shared"
    by_memory = ("--server", f"unix:{shared}/local.sock", "--transport", "memory")
    run(CANDELA, "sample", "--sequence", FOLDER / "in", "--size", "640x360", "--frames", "24")
    run(CANDELA, "stream", FOLDER / "in", FOLDER / "here")
    with containers(Container("--listen=unix:/tmp/candelad.sock,unix:/shared/local.sock", options=(volume,))) as (candelad,):
        run(CANDELA, "stream", FOLDER / "in", FOLDER / "there", *by_memory)
        expect_same(FOLDER / "there", digests(FOLDER / "here"))
        load = ("--seconds", "1", "--size", "320x180", "--transport", "memory", "--json", "-", "-q", "--server")
        for where in (run(CANDELA, "bench", *load, by_memory[1]),
                      podman.podman("run", "--rm", *podman.AS_SHIPPED, volume, "--entrypoint=candela", podman.IMAGE, "bench", *load,
                                    "unix:/shared/local.sock")):
            expect(json.loads(where)["transport"] == "memory", f"it was not by memory: {where}")
        expect("memfd:candela" not in podman.podman("exec", candelad.id, "sh", "-c", "cat /proc/[0-9]*/maps"),
               "the memory of clients that went is still there")


def resume_keys() -> tuple[pathlib.Path, str]:
    """Returns a file of keys and the option that mounts it in a container."""
    keys = FOLDER / "keys"
    keys.write_text(podman.KEYS)
    keys.chmod(0o400)
    shutil.chown(keys, 65532, 65532)
    return keys, f"--volume={keys}:/keys:ro"


def a_stop_under_load_loses_no_frame() -> None:
    keys, volume = resume_keys()
    film, expected = make_film(CANDELA, FOLDER, "320x180", 6, 4)
    with (podman.process(CANDELAD, "--listen", "127.0.0.1:0", "--resume-keys", keys, "--log-level", "off") as host,
          containers(Container("--resume-keys=/keys", options=(volume,))) as (candelad,)):
        other = host.stdout.readline().removeprefix("listening on ").strip()
        sessions = Sessions(CANDELA, FOLDER, 4, film, "--server", f"{candelad.address},{other}")
        try:
            wait_until(lambda: sessions.going(8), "every session has results")
            candelad.stop()
            sessions.expect_running()
            expect(candelad.exit_code() == 0, f"it ended with {candelad.exit_code()}:\n{candelad.log()}")
            expect("info stopped" in candelad.log(), f"it did not drain:\n{candelad.log()}")
            for summary in sessions.summaries(expected):
                expect(summary["resumes"] == 1 and summary["server"] == other, f"a session did not move once: {summary}")
        finally:
            sessions.kill()


def more_sessions_than_memory_are_refused_and_nothing_is_killed() -> None:
    run(CANDELA, "sample", FOLDER / "large.exr", "--size", "3840x2160")
    with containers(Container()) as (candelad,):
        bench = (CANDELA, "bench", "--server", candelad.address, "--size", "3840x2160", "--seconds", "15", "-q", "--sessions")
        crowd = attempt(*bench, 48)
        expect(crowd.returncode == 4 and "which is its limit" in crowd.stderr, f"48 sessions: {crowd.returncode}, {crowd.stderr}")
        wait_until(lambda: candelad.metric("candela_sessions") == 0, "sessions have ended")
        load = subprocess.Popen([*bench, "24"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            wait_until(lambda: candelad.metric("candela_sessions") >= 20, "sessions are open")
            answers: list[subprocess.CompletedProcess] = []
            callers = [threading.Thread(target=lambda i=i: answers.append(attempt(
                CANDELA, "render", FOLDER / "large.exr", FOLDER / f"{i}.png", "--server", candelad.address,
                "--resume", "0")))  # a refused image is not sent again when the crowd has left
                for i in range(8)]
            for caller in callers:
                caller.start()
            for caller in callers:
                caller.join()
            load.wait(timeout=300)
        finally:
            load.kill()
            load.wait()
        expect(candelad.running(), f"it ended with {candelad.exit_code()}:\n{candelad.log()}")
        refused = [answer.stderr for answer in answers if answer.returncode != 0]
        print(f"{len(refused)} of {len(answers)} images refused; most of 1 GB in use: {most_memory(candelad) / 1e6:.0f} MB")
        expect(refused and all("memory" in text for text in refused), f"nothing was refused for its memory: {refused}")
        expect(candelad.metric('candela_rejections_total{reason="memory"}') >= len(refused), "rejections are not counted")
        # The server serves as before.
        wait_until(lambda: candelad.metric("candela_sessions") == 0, "sessions have ended")
        run(CANDELA, "render", FOLDER / "large.exr", FOLDER / "after.png", "--server", candelad.address)


def most_memory(candelad: Container) -> int:
    """Reads bytes from the container's cgroup, version 1 or 2."""
    return int(podman.podman("exec", candelad.id, "sh", "-c", "cat /sys/fs/cgroup/memory/memory.max_usage_in_bytes"
                             " /sys/fs/cgroup/memory.peak 2>/dev/null || true").split()[0])


def proxy_config(replicas: list[Container], port: int, certificate: pathlib.Path) -> pathlib.Path:
    """Writes deploy/haproxy.cfg with this machine's addresses and certificate."""
    text = (podman.ROOT / "deploy/haproxy.cfg").read_text()
    changes = [(":50051 ssl crt /etc/haproxy/candela.pem", f"127.0.0.1:{port} ssl crt {certificate}")]
    for name, replica, grpc, metrics in zip("ab", replicas, (50061, 50062), (9461, 9462)):
        changes.append((f"server {name} 127.0.0.1:{grpc} check check-proto h1 port {metrics}",
                        f"server {name} {replica.address} check check-proto h1 port {replica.metrics_port}"))
    for before, after in changes:
        expect(text.count(before) == 1, f"deploy/haproxy.cfg has no '{before}'")
        text = text.replace(before, after)
    config = FOLDER / "haproxy.cfg"
    config.write_text(text)
    checked = attempt("haproxy", "-c", "-f", config)
    expect(checked.returncode == 0 and "WARNING" not in checked.stderr, f"haproxy says: {checked.stderr}")
    return config


def behind_haproxy_a_kill_and_a_rolling_restart_cost_no_frame() -> None:
    certificate, port = FOLDER / "candela.pem", podman.free_port()
    run("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1", "-addext",
        "subjectAltName=IP:127.0.0.1", "-keyout", FOLDER / "key.pem", "-out", FOLDER / "ca.pem")
    certificate.write_text((FOLDER / "ca.pem").read_text() + (FOLDER / "key.pem").read_text())
    volume = resume_keys()[1]
    film, expected = make_film(CANDELA, FOLDER, "320x180", 35, 8)
    replicas = [Container("--resume-keys=/keys", "--pre-drain=2s", options=(volume,)) for _ in range(2)]
    with containers(*replicas), podman.process("haproxy", "-db", "-f", proxy_config(replicas, port, certificate)):
        server = ("--server", f"127.0.0.1:{port}", "--tls-ca", FOLDER / "ca.pem")
        wait_until(lambda: attempt(CANDELA, "health", *server).returncode == 0, "the proxy serves")
        sessions = Sessions(CANDELA, FOLDER, 8, film, *server)
        try:
            wait_until(lambda: sessions.going(4), "every session has results")
            shares = [replica.metric("candela_sessions") for replica in replicas]
            expect(sum(shares) == 8 and min(shares) > 0, f"the replicas have {shares} sessions")
            killed_at = time.time()
            replicas[0].kill()
            wait_until(lambda: replicas[1].metric("candela_sessions") == 8, "the other one has all sessions",
                       sessions.state, 8, every=0.02)
            wait_until(lambda: not replicas[0].running(), "podman sees it")
            time.sleep(1)
            replicas[0].start()
            for replica in replicas:  # a rolling restart; sessions move while a server drains
                replica.stop()
                expect(replica.exit_code() == 0, f"it ended with {replica.exit_code()}:\n{replica.log()}")
                replica.start()
            sessions.expect_running()
            summaries = sessions.summaries(expected)
        finally:
            sessions.kill()
    gaps = sorted(sessions.longest_gaps(killed_at))
    moved = sorted(summary["seconds_without_results"] for summary in summaries)
    print(f"sessions {shares[0]:.0f} + {shares[1]:.0f}, {len(expected)} frames each; longest wait for an image after the kill: "
          f"{gaps[-1]:.2f} s (median of the sessions {statistics.median(gaps):.2f} s)")
    print(f"resumes {[summary['resumes'] for summary in summaries]}; without results in all, of three restarts: "
          f"{moved[0]:.2f} .. {moved[-1]:.2f} s a session")
    expect(gaps[-1] < 10, "a session waited for more than 10 s after a kill")


def kube_play_brings_it_up() -> None:
    pod.kube_play_brings_it_up(FOLDER, VERSION)


# A container that runs systemd, with the image's programs in it. Its mounts are shared, as systemd needs them for
# services.
MACHINE = f"""\
FROM {podman.IMAGE}
USER 0
RUN apt-get update && apt-get install -y --no-install-recommends --fix-broken \\
 && apt-get install -y --no-install-recommends systemd
RUN ln -s /usr/bin/candelad /usr/bin/candela-front /usr/local/bin/ && ln -s /dev/null /etc/systemd/system/nginx.service
COPY candelad.service candela-proxy.service /etc/systemd/system/
COPY nginx.conf /usr/local/share/candela/
ENTRYPOINT ["sh", "-c", "mount --make-rshared / && exec /lib/systemd/systemd"]
"""


def systemd_runs_the_unit_and_a_crash_a_hang_and_a_stop_cost_no_frame() -> None:
    podman.expect_package_mirror()
    (FOLDER / "Containerfile").write_text(MACHINE)
    podman.build(f"{podman.IMAGE}-systemd", FOLDER / "Containerfile", podman.ROOT / "deploy")
    film, expected = make_film(CANDELA, FOLDER, "320x180", 20, 1)
    machine = podman.podman("create", "--privileged", "--systemd=always", f"--volume={FOLDER}:{FOLDER}",
                            f"{podman.IMAGE}-systemd")

    def inside(*command: object) -> str:
        return podman.podman("exec", machine, *command)

    def unit(field: str) -> str:
        return inside("systemctl", "show", "--value", f"--property={field}", "candelad")

    def log() -> str:
        return attempt("podman", "exec", machine, "journalctl", "--no-pager", "--output=cat", "--unit=candelad").stdout

    def serves_as_another_process(before: str) -> bool:
        return unit("ActiveState") == "active" and unit("MainPID") != before

    shipped = (podman.ROOT / "deploy/candelad.service").read_text()
    offered = [line[1:] for line in shipped.splitlines() if line.startswith(("#LoadCredential=", "#Environment="))]
    expect(len(offered) == 2, f"the unit offers {offered}")
    try:
        podman.podman("start", machine)
        wait_until(lambda: attempt("podman", "exec", machine, "systemctl", "is-system-running").stdout.strip() == "running",
                   "systemd runs", lambda: attempt("podman", "exec", machine, "systemctl", "--failed").stdout)
        # Follow the runbook and the unit's comments, except for a shorter watchdog period.
        keys = FOLDER / "resume-keys"
        keys.write_text(podman.KEYS)
        keys.chmod(0o600)
        inside("install", "-D", "-m", "600", keys, "/etc/candela/resume-keys")
        (FOLDER / "drop-in.conf").write_text("\n".join(["[Service]", "WatchdogSec=3s", *offered, ""]))
        inside("install", "-D", "-m", "644", FOLDER / "drop-in.conf", "/etc/systemd/system/candelad.service.d/test.conf")
        # The image has its driver in an unusual place.
        inside("sh", "-c", "echo VK_DRIVER_FILES=$VK_DRIVER_FILES >/etc/candela/environment")
        inside("sh", "-c", "echo PROXY_INSECURE=true >/etc/candela/proxy")
        inside("systemctl", "enable", "--now", "candela-proxy", "candelad")
        expect(unit("StatusText").startswith("serving on unix:/run/candela/candelad.sock"), f"its status is {unit('StatusText')}")
        status = inside("cat", f"/proc/{unit('MainPID')}/status").split("\n")
        for fact in ("NoNewPrivs:\t1", "Seccomp:\t2", "CapEff:\t0000000000000000", "CapBnd:\t0000000000000000"):
            expect(fact in status, f"'{fact}' is not so: {status}")
        user = next(line.split()[1] for line in status if line.startswith("Uid:"))
        expect(61184 <= int(user) <= 65519, f"it runs as user {user}, who is not of systemd's making")

        session = subprocess.Popen(
            ["podman", "exec", machine, "candela", "stream", str(film), str(FOLDER / "there"), "--server", "127.0.0.1:50051",
             "--resume", "60", "--json", str(FOLDER / "there.json"), "-q"], stderr=subprocess.PIPE, text=True)
        try:
            def goes_on() -> None:
                have = len(list((FOLDER / "there").glob("*.png")))
                wait_until(lambda: len(list((FOLDER / "there").glob("*.png"))) > have + 8 or session.poll() is not None,
                           "the session has new results", log)
                expect(session.poll() is None, f"the session ended too soon, with {session.returncode}")

            goes_on()
            for what, hurt in (("crash", "KILL"), ("hang", "STOP")):
                before = unit("MainPID")
                inside("systemctl", "kill", f"--signal={hurt}", "candelad")
                wait_until(lambda: serves_as_another_process(before), f"systemd restarts it after a {what}", log, 60)
                goes_on()
            expect(unit("NRestarts") == "2", f"it was restarted {unit('NRestarts')} times")
            inside("systemctl", "restart", "candelad")
            expect(unit("Result") == "success" and log().count("info stopped") == 1, f"it did not drain:\n{log()}")
            goes_on()
            errors = session.communicate(timeout=300)[1]
            expect(session.returncode == 0, f"the session ended with {session.returncode}: {errors}")
        finally:
            session.kill()
            session.wait()
        expect_same(FOLDER / "there", expected)
        lines = [json.loads(line) for line in (FOLDER / "there.json").read_text().splitlines()]
        expect([frame["frame"] for frame in lines[:-1]] == list(range(len(expected))), "a result came twice or late")
        expect(lines[-1]["summary"]["resumes"] >= 3, f"the session resumed {lines[-1]['summary']['resumes']} times")
        files = inside("grep", "open files", f"/proc/{unit('MainPID')}/limits")
        expect(files.split()[3:5] == ["16384", "16384"], f"candelad has too few files: {files}")
        inside("systemctl", "stop", "candelad")
        expect(unit("ExecMainStatus") == "0" and unit("Result") == "success", f"it did not end well:\n{log()}")
        limit = inside("grep", "open files", f"/proc/{inside('systemctl', 'show', '--value', '--property=MainPID', 'candela-proxy')}/limits")
        expect(limit.split()[3] == "16384" and inside("systemctl", "show", "--value", "--property=NRestarts", "candela-proxy") == "0",
               f"the proxy was restarted, or has too few files: {limit}")
        inside("systemctl", "stop", "candela-proxy")
        print(f"{len(expected)} frames; {log().count('info serving')} starts under systemd "
              + inside("systemctl", "--version").split()[1])
    finally:
        attempt("podman", "rm", "--force", "--time=1", machine)


CLAIMS = {claim.__name__: claim for claim in (
    the_image_builds, the_image_is_small_and_holds_what_runs_and_says_what_it_is,
    the_gpu_image_has_mesas_drivers_and_still_runs_without_a_gpu, the_host_image_has_no_vulkan_and_is_half_as_large,
    the_sbom_lists_every_package,
    it_does_not_start_in_the_open_or_without_a_driver_and_says_why, it_renders_and_streams_the_hosts_bits,
    it_shares_memory_with_its_host_and_with_other_containers,
    a_stop_under_load_loses_no_frame, more_sessions_than_memory_are_refused_and_nothing_is_killed,
    behind_haproxy_a_kill_and_a_rolling_restart_cost_no_frame, kube_play_brings_it_up,
    systemd_runs_the_unit_and_a_crash_a_hang_and_a_stop_cost_no_frame)}


def main() -> None:
    global CANDELA, CANDELAD, VERSION, FOLDER
    name, binaries, VERSION = sys.argv[1:]
    claim = CLAIMS[re.sub("(?<!^)([A-Z])", r"_\1", name).lower()]
    CANDELA, CANDELAD = f"{binaries}/candela", f"{binaries}/candelad"
    with podman.prepared(), tempfile.TemporaryDirectory(prefix="candela-deploy-") as folder:
        FOLDER = pathlib.Path(folder)
        FOLDER.chmod(0o755)
        if claim != the_image_builds and attempt("podman", "image", "exists", podman.IMAGE).returncode != 0:
            podman.skip("there is no image; TheImageBuilds says why")
        claim()


if __name__ == "__main__":
    main()
