"""compare.py's measurements as a table and as a chart."""
from html import escape

LABEL, BAR, LINE, NUMBER = 310, 400, 24, 130


def machine(result: dict) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return (f"{result['processor']}; {result['device']}; {versions}. {result['date']}, {result['rounds']} rounds in turn, "
            f"{result['seconds']} s. Load before: {result['load_before']:.2f}; {others(result)}.")


def others(result: dict) -> str:
    cores = result["cores_used_by_others"]
    return f"other work used {cores['median']:.2f} ({cores['min']:.2f} to {cores['max']:.2f}) cores during a round"


def groups(result: dict) -> dict[str, list[dict]]:
    by_group: dict[str, list[dict]] = {}
    for row in result["rows"]:
        by_group.setdefault(row["group"], []).append(row)
    return by_group


def number(ms: float) -> str:
    return f"{ms:.1f}" if ms < 100 else f"{ms:.0f}"


def time_cells(row: dict) -> str:
    if "left_out" in row:
        return f"left out: {row['left_out']} | | |"
    ratio = f"{row['x_memcpy']['median']:.1f}x" if "x_memcpy" in row else ""
    return f"{number(row['median'])} ({number(row['min'])} to {number(row['max'])}) | {ratio} | {number(row['cpu_ms']['median'])} |"


def markdown(result: dict) -> str:
    lines = [machine(result), ""]
    copy = result["memcpy"]
    for group, rows in groups(result).items():
        lines += [f"| {group} | ms, median (min to max) | memcpy | processor ms | does | does not |",
                  "|---|--:|--:|--:|---|---|"]
        if any("x_memcpy" in row for row in rows):
            spread = f"{copy['median']:.2f} ({copy['min']:.2f} to {copy['max']:.2f})"
            lines.append(f"| memcpy of the frame | {spread} | 1x | | | |")
        lines += [f"| {row['label']} | {time_cells(row)} {row['does']} | {row['does_not']} |" for row in rows]
        lines.append("")
    if codes := result["codes_from_oiiotool"]:
        lines.append(f"oiiotool's picture and that of `candela render` without bloom are {codes['mean']:.2f} codes of 8 bits "
                     f"apart in the mean, {codes['max']:.0f} at most.")
        lines.append("")
    lines += ["| what | aim | measured | |", "|---|---|---|---|"]
    lines += [f"| {aim['what']} | {aim['aim']} | {aim['measured']} | {'met' if aim['met'] else 'missed'} |" for aim in result["aims"]]
    return "\n".join(lines) + "\n"


def bar(row: dict, top: float, y: int) -> str:
    x = {key: LABEL + BAR * row[key] / top for key in ("median", "min", "max")}
    color = "#1b4f8a" if row["ours"] else "#d9822b"
    middle = y + LINE // 2 - 3
    return (f'<text x="{LABEL - 8}" y="{middle + 4}" text-anchor="end">{escape(row["label"])}</text>'
            f'<rect x="{LABEL}" y="{y}" width="{x["median"] - LABEL:.1f}" height="{LINE - 6}" fill="{color}"/>'
            f'<path d="M{x["min"]:.1f} {middle}H{x["max"]:.1f}M{x["min"]:.1f} {middle - 4}v8M{x["max"]:.1f} {middle - 4}v8" '
            f'stroke="#333"/><text x="{x["max"] + 8:.1f}" y="{middle + 4}">{number(row["median"])} ms</text>')


def svg(result: dict) -> str:
    parts, y = [], 8
    for group, rows in groups(result).items():
        measured = [row for row in rows if "median" in row]
        top = max(row["max"] for row in measured)
        parts.append(f'<text x="8" y="{y + 14}" font-weight="bold">{escape(group)}</text>')
        y += 26
        for row in measured:
            parts.append(bar(row, top, y))
            y += LINE
        y += 12
    width = LABEL + BAR + NUMBER
    words = (f"Medians of {result['rounds']} rounds, whiskers least to most. {result['processor']}, "
             f"{result['device'].partition(' (llvmpipe')[0]}, {result['date']}.")
    parts.append(f'<text x="8" y="{y + 8}" fill="#555" font-size="11">{escape(words)}</text>')
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {y + 18}" font-family="sans-serif" font-size="13">'
            f'<rect width="100%" height="100%" fill="white"/>{"".join(parts)}</svg>\n')
