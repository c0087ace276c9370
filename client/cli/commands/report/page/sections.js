// The sections of the report's page, from top to bottom.
"use strict";

const tierCount = report ? report.tiers.length : 0;

function advice(tier, front) {
  const at = front.findIndex((cost) => cost.tier === tier);
  if (at < 0) return "no: another tier is faster and at least as accurate";
  if (front.length === 1) return "always: it is the fastest and the most accurate";
  if (at === 0) return "when time counts most";
  return at === front.length - 1 ? "when the error must be smallest" : "between the two";
}

function verdict(failures, good, bad) {
  return failures === 0 ? good : html("span", {class: "bad"}, `${failures} ${bad}`);
}

function summary() {
  const rows = rowsToCompare(verified()), front = paretoFront(rows.map(frameCost));
  const about = (tier) => (report.tiers.find((known) => known.name === tier) || {summary: ""}).summary;
  const failed = report.hard_cases.filter((row) => row.error);
  const infinite = report.hard_cases.filter((row) => !row.error && !row.finite);
  const over = report.stage_errors.filter((row) => !row.ok);
  return [
    rows.length === 0 ? paragraph("No tier was both timed and verified.")
      : paragraph(`At ${size(rows[0])}, with half floats in, 8-bit sRGB out and bloom:`),
    rows.length === 0 ? "" : table(
      ["tier", "use it", "ms per frame", "times a memcpy", "largest error, codes", "trade-off"],
      rows.map((row) => [html("b", {}, row.tier), advice(row.tier, front), number(row.device_ms.median),
        ratio(row.memcpy_ratio), number(row.error.max_codes), about(row.tier)])),
    html("p", {}, verdict(over.length, "Every stage is within its bound", "stages exceed their bounds"), "; ",
      verdict(failed.length, "every hard case rendered", "hard cases failed"), "; ",
      verdict(infinite.length, "every result is finite", "results contain NaN or infinities"), "."),
  ];
}

function machine() {
  return [
    table([], Object.entries(report.machine).map(([name, value]) => [name, value])),
    html("h3", {}, "Run it again"),
    html("pre", {}, `${report.command}\n`
      + "candela render IN.exr OUT.png --tier TIER --verify --error-map MAP.png   # one image"),
    paragraph("report.json in this folder holds every number of this page. times.csv, hard_cases.csv, aces.csv, "
      + "files.csv and bakes.csv hold their tables."),
  ];
}

function timesRow(row) {
  if (row.skipped) return [size(row), row.tier, message(`skipped: ${row.skipped}`, 8)];
  const error = row.error ? ["max_codes", "p999_codes", "mean_codes"].map((key) => number(row.error[key]))
    : [message(row.error_skipped, 3)];
  return [size(row), row.tier, spreadCell(row.device_ms), number(row.memcpy_ms.median), ratio(row.memcpy_ratio),
    number(row.call_ms.median), count(row.frames), ...error];
}

function times() {
  return [
    paragraph("Each point is a tier at a frame size. Points further left are faster, and lower points are more "
      + "accurate. A line is the Pareto front of its size: the least error for the time. Bars reach from p10 to "
      + "p90. A tier above the line of its size is beaten by another one. The error is the largest of any pixel against "
      + "the float64 reference, in codes of 1/255 before quantising, on the sample scene with default settings. Above "
      + "0.5 codes an 8-bit picture may differ by more than one code. "
      + `Errors under ${tickWords(ERROR_FLOOR)} codes, including 0, are drawn at ${tickWords(ERROR_FLOOR)}.`),
    ...(verified().length ? [chart(drawTimeAgainstError)] : []),
    table(["size", "tier", "device, ms (p10 .. p90)", "memcpy, ms", "times a memcpy", "whole call, ms", "frames",
      "max error", "p99.9", "mean"], report.times.map(timesRow)),
    paragraph("Device time is the sum of the stages without the queue: the median, with the 10th and 90th percentile "
      + "in parentheses. The memcpy copies the input frame (8 bytes per pixel) once next to every timed frame; it shows "
      + "what touching that memory costs on this machine at that moment. The whole call is the time that a client "
      + "waits. Errors are in codes."),
    html("h3", {}, "Time per megapixel"),
    paragraph("A level line means that the time is proportional to the number of pixels. Bars reach from p10 to p90."),
    ...(timed().length ? [chart(drawTimePerMegapixel)] : []),
  ];
}

function stageWords(row) {
  return html("span", {}, ...row.stages.flatMap((stage, i) => [i ? ", " : "", `${stage.name} `, spread(stage.ms)]));
}

function stages() {
  if (!timed().length) return [paragraph("No tier was timed.")];
  return [
    paragraph(`The chart shows the medians at ${size(stageRows()[0])}, the largest size at which the most tiers were `
      + `timed. Tiers that take more than ${BEYOND_SCALE} times as long as the fastest are only in the table.`),
    chart(drawStages),
    table(["size", "tier", "stages, ms: median (p10 .. p90)"],
      timed().map((row) => [size(row), row.tier, stageWords(row)])),
  ];
}

function bounds() {
  return [
    paragraph("The bounds that docs/pipeline.md promises, and the worst result of all hard cases, curves and images of "
      + `this page at tier ${report.bounded_tier}. Differing components are counted only on frames with at least 1000 `
      + "components."),
    table(["stage", "unit", "bound", "measured", "worst on", "verdict"], report.stage_errors.map((row) =>
      [row.stage, row.unit, number(row.bound), number(row.measured), row.where,
        {content: row.ok ? "within" : "EXCEEDED", bad: !row.ok}])),
  ];
}

function errorCell(row) {
  if (row.error) return message(row.error, 1, true);
  return row.finite ? number(row.max_error_codes) : message("NOT FINITE", 1, true);
}

// The rows of one case, one per tier, as one row of the table.
function hardCase(rows) {
  const shown = rows.find((row) => row.tier === report.bounded_tier) || rows[0];
  const head = [shown.case, size(shown), shown.expected], tiers = rows.map(errorCell);
  if (shown.error) return [...head, message(shown.error, 3, true), ...tiers];
  const {min, max, mean} = shown.picture;
  return [...head, `${min} .. ${max}, mean ${short(mean)}${shown.note ? `; ${shown.note}` : ""}`,
    number(shown.exposure, 4), {content: `${shown.nan} / ${shown.inf} / ${shown.negative}`, number: true}, ...tiers];
}

function hardCases() {
  const cases = [];
  for (let i = 0; i < report.hard_cases.length; i += tierCount) cases.push(report.hard_cases.slice(i, i + tierCount));
  return [
    paragraph("Frames on which image pipelines often fail. The last columns are the largest error of each tier against "
      + "the float64 reference, which follows the stated result. A number there also means that every value of the "
      + `floating-point picture is finite. Picture and exposure are those of tier ${report.bounded_tier}. The counts are `
      + "of components of the input frame."),
    table(["case", "size", "stated result", "picture, 8-bit codes", "exposure", "NaN / Inf / negative in the input",
      ...report.tiers.map((tier) => `${tier.name}, codes`)], cases.map(hardCase)),
  ];
}

function aces() {
  const {missing, reference, tier, rows} = report.aces;
  if (missing) return [paragraph(`Not measured: ${missing}.`)];
  const numbers = (row) => row.error ? [message(row.error, 6, true)]
    : ["codes", "delta_e"].flatMap((kind) => ["max", "p95", "mean"].map((key) => number(row[kind][key])));
  return [
    paragraph(`The approximations compared with curve ${reference} at tier ${tier}, which is the whole transform by `
      + `OpenColorIO without a table. The pictures have 16 bits. The rows of ${reference} itself are the tables of the `
      + "cheaper tiers; docs/pipeline.md, section 5, gives their errors by table size. Codes are the largest difference "
      + "of R, G and B in 1/255 of the display range. dE is CIEDE2000 by Little CMS under D65; a dE of about 1 is just "
      + "visible side by side. Charts are rendered at exposure 1, images as metered, all without bloom."),
    table(["colours", "curve", "tier", "codes: max", "p95", "mean", "dE: max", "p95", "mean"],
      rows.map((row) => [row.set, row.curve, row.tier, ...numbers(row)])),
  ];
}

function curves() {
  return [
    paragraph(`The passes on the sample scene of 1280x720 at tier ${report.bounded_tier}, median with p10 and p90, and `
      + "the largest error on 320x180. A code is 1/255 of the display's range, with PQ and HLG, too."),
    table(["curve", "passes, ms (p10 .. p90)", "max error, codes", "p99.9", "mean"], report.curves.map((row) =>
      [row.case.replace("sample scene, ", ""), ...(row.error ? [message(row.error, 4, true)]
        : [spreadCell(row.device_ms), number(row.max_error_codes), number(row.p999_error_codes),
          number(row.mean_error_codes)])])),
  ];
}

function files() {
  const shown = report.files.find((row) => !row.error);
  return [
    paragraph(`The first image${shown ? ` (${size(shown)})` : ""} in each kind of file. Errors are against its codes of 16 `
      + "bits, so rounding to 8 or 10 bits is in them. Reading gives codes, not light."),
    table(["file", "bytes", "write, ms (p10 .. p90)", "read, ms", "max error, codes", "p99.9", "mean"],
      report.files.map((row) => [row.kind, ...(row.error ? [message(row.error, 6, true)]
        : [count(row.bytes), spreadCell(row.write_ms), spreadCell(row.read_ms), number(row.max_codes),
          number(row.p999_codes), number(row.mean_codes)])])),
  ];
}

function figure(file, caption, kind = "") {
  return html("figure", {class: kind}, html("img", {src: file, alt: caption, loading: "lazy"}), html("figcaption", {}, caption));
}

function errorMap(map) {
  if (map.error) return paragraph(`${map.tier}: ${map.error}`);
  const {max_error_codes: max, p999_error_codes: p999, mean_error_codes: mean, differing_components: differing} = map;
  return figure(map.file, `${map.tier}: at most ${short(max)} codes, p99.9 ${short(p999)}, mean ${short(mean)}; `
    + `${short(100 * differing)} % of components differ once quantised`);
}

function errorMaps() {
  return [
    paragraph(`The colours show ${report.error_map_scale}. Every map uses the same scale. If a map is smaller than its `
      + "image, each of its pixels shows the largest error of those it covers."),
    ...report.images.flatMap((image) => [
      html("h3", {}, `${image.name}, ${size(image)}${image.note}`),
      html("div", {class: "pictures"}, ...(image.file ? [figure(image.file, "as rendered")] : []),
        ...image.maps.map(errorMap)),
    ]),
  ];
}

const percent = (value) => number(typeof value === "number" ? 100 * value : value);

function bakeRow(row) {
  const head = [row.panorama, count(row.size), row.tier];
  if (row.skipped) return [...head, message(`skipped: ${row.skipped}`, 5)];
  const errors = row.levels
    ? [percent(row.max_error), row.levels.map(({error}) => percent(error).content).join(", ")]
    : [message(row.error_skipped, 2)];
  return [...head, spreadCell(row.device_ms), number(row.call_ms.median), stageWords(row), ...errors];
}

function panoramaPictures(row) {
  const put = row.put_ms ? `; sent and stored in ${short(row.put_ms)} ms` : "";
  return [
    html("h3", {}, `${row.name}, ${size(row)}${put}`),
    ...(row.error ? [paragraph(row.error)] : []),
    html("div", {class: "pictures"},
      ...(row.lookdev ? [figure(row.lookdev, "the view of lookdev: spheres of chrome, grey, gold and plastic")] : []),
      ...(row.levels ? [figure(row.levels, "every level as a cross, from the sharpest to the roughest", "wide")] : [])),
  ];
}

function environments() {
  return [
    paragraph("A bake makes the cube map and the specular levels of a panorama. The error of a level is relative, against "
      + "the float64 sum over the panorama; docs/environments.md, section 7, defines it. The chart shows the largest error "
      + "of the levels. Device time is that of the server; the whole call also sends the levels to the client."),
    ...(verifiedBakes().length ? [chart(drawBakes)] : []),
    table(["panorama", "cube map", "tier", "device, ms (p10 .. p90)", "whole call, ms", "stages, ms: median (p10 .. p90)",
      "max error, %", "error of each level, %"], report.bakes.map(bakeRow)),
    ...report.environments.flatMap(panoramaPictures),
  ];
}

function planWords(lines) {
  return html("span", {}, ...lines.flatMap((text, i) => (i ? [html("br"), text] : [text])));
}

function scenes() {
  return [
    paragraph("Each row changes one thing of the first row. \"nothing bright\" and \"five small lights\" are the same "
      + "picture, clamped to a quarter of the bloom's threshold. The memcpy copies the input frame, next to every timed "
      + "frame. The plan is what the server reports."),
    table(["scene", "size", "device, ms (p10 .. p90)", "memcpy, ms", "times a memcpy", "the server's plan"],
      report.scenes.map((row) => row.error ? [row.what, message(row.error, 5, true)]
        : [row.what, size(row), spreadCell(row.device_ms), number(row.memcpy_ms.median), ratio(row.memcpy_ratio),
          planWords(row.plan)])),
  ];
}

function drawPage() {
  const main = document.querySelector("main");
  if (!report) return main.replaceChildren(paragraph("This page holds no report. `candela report DIR` writes one."));
  const sections = [
    ["Machine", "The machine", machine], ["Time and error", "Time against error", times],
    ["Stages", "Time by stage", stages], ["Bounds", "Every stage's error and its bound", bounds],
    ["Hard cases", "Hard cases", hardCases], ["ACES", "The ACES approximations against the whole transform", aces],
    ["Curves", "Curves: time and error", curves], ["Files", "Files: time and error", files],
    ["Error maps", "Error maps", errorMaps], ["Scenes", "What a scene does not need is not computed", scenes],
    ["Environments", "Environments", environments],
  ];
  document.title = `Candela on ${report.machine.device}`;
  main.replaceChildren(
    html("h1", {}, document.title),
    html("p", {class: "quiet"}, `candela ${report.machine.candela}, ${report.date}, measured in `
      + `${report.seconds.toFixed(0)} s${report.quick ? " with --quick" : ""}`),
    html("nav", {}, ...sections.map(([name], i) => html("a", {href: `#section-${i}`}, name))),
    ...summary(),
    ...sections.flatMap(([, heading, content], i) => [html("h2", {id: `section-${i}`}, heading), ...content()]));
  drawCharts();
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth !== width) drawCharts();
    width = innerWidth;
  });
}

drawPage();
