"""The outcome of one case, and the comparison of two."""
import dataclasses
import hashlib
import json

# Not compared: times, what names the machine or the build, what other cases left on the server, the
# sizes of files, and prose.
LEFT_OUT = {"times", "stage_ms", "total_ms", "latency_ms", "mean_latency_ms", "seconds", "frames_per_second",
            "seconds_without_results", "uptime_seconds", "frames_rendered", "sessions", "pool", "device", "driver",
            "version", "had_it", "encoded_bytes", "address", "server", "input", "output", "error", "plan", "tier_reason",
            "notes", "memory_budget_bytes"}
LONGEST_LIST = 64


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def flatten(value, path: str = "") -> dict[str, str]:
    """The leaves of a JSON value by path. Numbers stay the text they were written as."""
    if isinstance(value, dict):
        children = [(f"{path}.{key}" if path else key, child) for key, child in value.items() if key not in LEFT_OUT
                    and
                    not (key == "summary" and isinstance(child, str))]
    elif isinstance(value, list) and len(value) > LONGEST_LIST:
        return {path: "sha256 " + digest(json.dumps(value).encode())}
    elif isinstance(value, list):
        children = [(f"{path}[{i}]", child) for i, child in enumerate(value)]
    else:
        text = json.dumps(value) if value is None or isinstance(value, bool) else str(value)
        return {} if text.startswith("/") else {path: text}
    return {leaf: text for child_path, child in children for leaf, text in flatten(child, child_path).items()}


@dataclasses.dataclass
class Outcome:
    exit: str  # exit code, or gRPC status
    image: str = ""
    values: dict[str, str] = dataclasses.field(default_factory=dict)

    @staticmethod
    def of_json(exit_code: str, image: str, text: str) -> "Outcome":
        """`text` holds one JSON value a line; several lines are numbered."""
        lines = [json.loads(line, parse_float=str, parse_int=str) for line in text.splitlines()]
        return Outcome(exit_code, image, flatten(lines[0] if len(lines) == 1 else lines))

    def differs_from(self, before: "Outcome") -> list[str]:
        parts = [part for part in ("exit", "image") if getattr(self, part) != getattr(before, part)]
        paths = [path for path, text in before.values.items() if self.values.get(path, "absent") != text]
        parts += [name for name in ("exposure", "target") if any(path.split(".")[-1] == name for path in paths)]
        return parts + [f"json: {path} was {before.values[path]}, is {self.values.get(path, 'absent')}"
                        for path in paths[:3]]
