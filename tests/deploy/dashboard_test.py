"""Runs every query of the dashboard, the autoscaler and the alerts on a real Prometheus that scrapes a loaded candelad.

  dashboard_test.py CANDELA CANDELAD

Everything runs on free loopback ports. Exits with 77 and a reason if there is no Prometheus or no nginx.
"""

import contextlib
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request

from podman import free_port

CANDELA, CANDELAD = sys.argv[1:]
DEPLOY = pathlib.Path(__file__).resolve().parents[2] / "deploy"
LIMIT_S = 60
# Grafana's variables; here all servers, and an interval of some scrapes.
VARIABLES = {"$__rate_interval": "10s", "$instance": ".*"}
# Panels that must show more than zeros while frames arrive and clients are refused.
MOVING = {"Servers serving", "Sessions", "Frames per second", "Clients refused per second", "Queue wait",
          "Frame time, by stage", "Frames per second, by result", "Refusals per second, by reason",
          "Device busy", "Sessions, by server", "Memory", "Traffic", "Resident memory, by server",
          "Processors used, by server", "Time until certificates expire", "Versions", "autoscaler"}

for program in ("prometheus", "nginx"):
    if not shutil.which(program):
        print(f"skipped: no {program}; as root: apt-get install {program}")
        sys.exit(77)


def replace_once(text, pattern, replacement):
    text, count = re.subn(pattern, replacement, text)
    if count != 1:
        sys.exit(f"prometheus.yaml: {pattern} is there {count} times")
    return text


@contextlib.contextmanager
def running(command, log):
    with log.open("w") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_for(what, find):
    end = time.monotonic() + LIMIT_S
    while not (found := find()):
        if time.monotonic() > end:
            sys.exit(f"{what}: not within {LIMIT_S} s")
        time.sleep(0.2)
    return found


class Prometheus:
    def __init__(self, port):
        self.base = f"http://127.0.0.1:{port}"
        self.opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))

    def get(self, path, **arguments):
        try:
            with self.opener.open(f"{self.base}{path}?{urllib.parse.urlencode(arguments)}", timeout=20) as answer:
                return json.load(answer)["data"]
        except urllib.error.HTTPError as error:
            sys.exit(f"{arguments}: {error.read().decode()}")

    def ready(self):
        try:
            return self.opener.open(f"{self.base}/-/ready", timeout=5).status == 200
        except OSError:
            return False

    def values(self, query):
        return [float(sample["value"][1]) for sample in self.get("/api/v1/query", query=query)["result"]]


def dashboard_queries():
    """Yields (panel, query) for every query, including the one that fills the list of servers."""
    dashboard = json.loads((DEPLOY / "grafana.json").read_text())
    ids = [panel["id"] for panel in dashboard["panels"]]
    if len(set(ids)) != len(ids):
        sys.exit("grafana.json: two panels have one id")
    for variable in dashboard["templating"]["list"]:
        if variable["type"] == "query":
            yield variable["name"], re.fullmatch(r"label_values\((.*), \w+\)", variable["query"])[1]
    for panel in dashboard["panels"]:
        for target in panel["targets"]:
            query = target["expr"]
            for name, value in VARIABLES.items():
                query = query.replace(name, value)
            if "$" in query:
                sys.exit(f"{panel['title']}: a variable is left: {query}")
            yield panel["title"], query


def alert_selectors():
    """The metric selectors in the alerts' expressions."""
    text = (DEPLOY / "alerts.yaml").read_text()
    expressions = "".join(re.findall(r"expr: (.*(?:\n {10}.*)*)", text))
    selectors = set(re.findall(r'\b[a-z_]+\{job="candela"[^}]*\}', expressions))
    if len(selectors) < text.count("- alert:"):
        sys.exit(f"the alerts look at more than {selectors}")
    return selectors


def autoscaler_query():
    """The query that prometheus-adapter makes from its rule in kube.yaml, by server."""
    comment = re.search(r"#         sum by.*\n(?:#         .*\n)*", (DEPLOY / "kube.yaml").read_text())[0]
    query = " ".join(line[1:].strip() for line in comment.splitlines())
    return query.replace("<<.GroupBy>>", "instance").replace("<<.LabelMatchers>>", 'job="candela"').replace("[2m]", "[10s]")


def is_answer(panel, values):
    if not values or any(value != value for value in values):  # nothing, or 0 / 0
        return False
    return panel not in MOVING or any(value > 0 for value in values)


def main(scratch):
    daemon_log, prometheus_log, bench_log = (scratch / name for name in ("candelad", "prometheus", "bench"))
    daemon = [CANDELAD, "--listen", "127.0.0.1:0", "--metrics", "127.0.0.1:0", "--max-sessions", "2", "--log-json"]
    with contextlib.ExitStack() as stack:
        stack.enter_context(running(daemon, daemon_log))
        serving = re.compile(r'"address":"([^"]+)".*"metrics":"([^"]+)"')
        server, metrics = wait_for("candelad", lambda: serving.search(daemon_log.read_text())).groups()

        status = f"127.0.0.1:{free_port()}"
        scratch.chmod(0o755)  # nginx's workers have a user of their own if root starts it
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-subj", "/CN=front", "-days", "60", "-keyout", scratch / "front.key", "-out", scratch / "front.crt"],
                       check=True, capture_output=True)
        settings = [f"PROXY_CERT={scratch}/front.crt", f"PROXY_LISTEN=127.0.0.1:{free_port()}", f"PROXY_STATUS={status}",
                    f"PROXY_SERVER=unix:{scratch}/nobody"]
        stack.enter_context(running(["env", *settings, DEPLOY / "candela-front", "--proxy-only"], scratch / "front"))

        config = (DEPLOY / "prometheus.yaml").read_text()
        config = replace_once(config, r"127\.0\.0\.1:9464", metrics)
        config = replace_once(config, r"127\.0\.0\.1:9465", status)
        config = replace_once(config, r"scrape_interval: 15s", "scrape_interval: 1s")
        config = replace_once(config, r"evaluation_interval: 15s", "evaluation_interval: 1s")
        (scratch / "prometheus.yaml").write_text(config)
        shutil.copy(DEPLOY / "alerts.yaml", scratch)
        port = free_port()
        stack.enter_context(running(
            ["prometheus", f"--config.file={scratch}/prometheus.yaml", f"--storage.tsdb.path={scratch}/data",
             f"--web.listen-address=127.0.0.1:{port}", "--log.level=warn"], prometheus_log))
        prometheus = Prometheus(port)
        wait_for(f"prometheus ({prometheus_log.read_text()})", prometheus.ready)

        wait_for("a wait of 0 without frames", lambda: prometheus.values(autoscaler_query()) == [0])

        # Open as many sessions as the server allows. It refuses every further one.
        load = [CANDELA, "bench", "--server", server, "--size", "320x180", "--fps", "10", "--quiet",
                "--seconds", str(5 * LIMIT_S)]
        bench = stack.enter_context(running([*load, "--sessions", "2"], bench_log))
        wait_for("the load", lambda: sum(prometheus.values("candela_sessions")) == 2)
        stack.enter_context(running(load, scratch / "refused"))

        wanted = list(dashboard_queries()) + [("", selector) for selector in alert_selectors()]
        wanted.append(("autoscaler", autoscaler_query()))
        pending = wanted
        end = time.monotonic() + LIMIT_S
        while pending and time.monotonic() < end:
            time.sleep(1)
            pending = [(panel, query) for panel, query in pending if not is_answer(panel, prometheus.values(query))]
        for panel, query in pending:
            print(f"{panel or 'alerts'}: {query} gives {prometheus.values(query)}", file=sys.stderr)

        rules = [rule for group in prometheus.get("/api/v1/rules")["groups"] for rule in group["rules"]]
        for rule in rules:
            if rule["health"] != "ok" or rule["state"] == "firing":
                pending.append(rule)
                print(f"{rule['name']}: {rule['health']}, {rule['state']} {rule.get('lastError', '')}", file=sys.stderr)
        if bench.poll() is not None:
            sys.exit(f"the load ended too soon: {bench_log.read_text()}")
        if pending:
            sys.exit(1)
        print(f"{len(wanted)} queries answered, {len(rules)} alerts evaluated")


with tempfile.TemporaryDirectory() as folder:
    main(pathlib.Path(folder))
