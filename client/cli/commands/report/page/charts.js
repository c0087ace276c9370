// The charts of the report's page: SVG as wide as the page, drawn again when the width changes.
"use strict";

const ERROR_FLOOR = 1e-6;  // codes; smaller errors have no place on a log scale and are drawn here
const BAKE_BOUND = 0.02;         // docs/environments.md, section 7
const BAKE_ERROR_FLOOR = 1e-6;   // relative
const BEYOND_SCALE = 8;    // the chart of the stages omits tiers that take this many times the fastest one's time
const COLORS = ["#1b4f8a", "#d9822b", "#3f8f82", "#777777", "#7b3f7d", "#a3932f", "#c0504d"];
const LETTER = 7.2;        // pixels: an upper estimate of a letter's width at the charts' font size

const charts = [];

function chart(draw) {
  const place = html("div", {class: "chart"});
  charts.push(() => place.replaceChildren(draw(Math.max(300, Math.min(860, place.clientWidth || 860)))));
  return place;
}

function drawCharts() {
  for (const draw of charts) draw();
}

const label = (x, y, text, attributes = {}) => svg("text", {x, y, fill: "#333", ...attributes}, text);
const line = (x1, y1, x2, y2, attributes = {}) => svg("line", {x1, y1, x2, y2, stroke: "#888", ...attributes});
const tickWords = (value) => (value >= 1e4 || value < 1e-3) && value !== 0
  ? value.toExponential(0).replace("e+", "e") : String(Number(value.toPrecision(6)));

function marker(kind, x, y, color) {
  const r = 4.5;
  const points = [
    null,
    [[-r, -r], [r, -r], [r, r], [-r, r]],
    [[0, -r - 1], [r + 1, r], [-r - 1, r]],
    [[0, r + 1], [r + 1, -r], [-r - 1, -r]],
    [[0, -r - 1], [r + 1, 0], [0, r + 1], [-r - 1, 0]],
  ][kind % 5];
  if (!points) return svg("circle", {cx: x, cy: y, r, fill: color});
  return svg("polygon", {points: points.map(([dx, dy]) => `${x + dx},${y + dy}`).join(" "), fill: color});
}

// Powers of ten, and 2 and 5 times them while there is room; of many decades every second or third one.
function logTicks(low, high, room) {
  const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high));
  const steps = room / ((last - first) || 1) >= 3 ? [1, 2, 5] : [1];
  const stride = Math.max(1, Math.ceil((last - first) / room));
  const ticks = [];
  for (let decade = first; decade <= last; decade += stride) {
    for (const step of steps) ticks.push(step * 10 ** decade);
  }
  return ticks.filter((tick) => tick >= low * 0.999 && tick <= high * 1.001);
}

// Maps [low, high], widened by the factor `margin` at both ends, to [from, to] on a log scale.
function logScale(values, from, to, room, margin = 1.4) {
  const low = Math.min(...values) / margin, high = Math.max(...values) * margin;
  const at = (value) => from + (to - from) * Math.log(value / low) / Math.log(high / low);
  return {at, ticks: logTicks(low, high, room)};
}

// Items side by side, in as many rows as they need. Returns the elements and the height that they take.
function legend(items, left, width) {
  const elements = [];
  let x = left, y = 12;
  for (const item of items) {
    const wide = 30 + LETTER * item.text.length;
    if (x > left && x + wide > left + width) [x, y] = [left, y + 20];
    elements.push(...item.sign(x + 8, y - 4), label(x + 20, y, item.text));
    x += wide;
  }
  return {elements, height: y + 12};
}
const dot = (kind, color) => (x, y) => [marker(kind, x, y, color)];
const stroke = (color) => (x, y) => [line(x - 7, y, x + 7, y, {stroke: color, "stroke-width": 2.5})];

// The area of a chart under its legend, with room for the axes' labels.
function frame(width, items) {
  const box = {left: 58, right: width - 14};
  const signs = legend(items, 8, width - 16);
  box.top = signs.height + 26;
  box.bottom = box.top + (width < 500 ? 240 : 320);
  const root = svg("svg", {
    xmlns: "http://www.w3.org/2000/svg", viewBox: `0 0 ${width} ${box.bottom + 46}`, width, height: box.bottom + 46,
    "font-family": "system-ui, sans-serif", "font-size": 12, role: "img",
  }, svg("rect", {width, height: box.bottom + 46, fill: "#fff"}), ...signs.elements);
  return {root, box};
}

function xAxis({root, box}, scale, title) {
  for (const tick of scale.ticks) {
    root.append(line(scale.at(tick), box.top, scale.at(tick), box.bottom, {stroke: "#e4e4e4"}),
      label(scale.at(tick), box.bottom + 17, tickWords(tick), {"text-anchor": "middle"}));
  }
  root.append(line(box.left, box.bottom, box.right, box.bottom),
    label((box.left + box.right) / 2, box.bottom + 38, title, {"text-anchor": "middle"}));
}

function yAxis({root, box}, scale, title) {
  for (const tick of scale.ticks) {
    root.append(line(box.left, scale.at(tick), box.right, scale.at(tick), {stroke: "#e4e4e4"}),
      label(box.left - 7, scale.at(tick) + 4, tickWords(tick), {"text-anchor": "end"}));
  }
  root.append(line(box.left, box.top, box.left, box.bottom), label(8, box.top - 12, title));
}

const timed = () => report.times.filter((row) => row.device_ms);
const verified = () => timed().filter((row) => row.error && typeof row.error.max_codes === "number");
const verifiedBakes = () => report.bakes.filter((row) => typeof row.max_error === "number");
const tierNames = () => [...new Set(report.times.map((row) => row.tier))];
const tierIndex = (tier) => tierNames().indexOf(tier);

// What a tier costs and keeps: {tier, ms: a spread, error}.
const frameCost = (row) => ({tier: row.tier, ms: row.device_ms, error: row.error.max_codes});
const bakeCost = (row) => ({tier: row.tier, ms: row.device_ms, error: row.max_error});

// The costs that no other one beats in both time and error, by rising time.
function paretoFront(costs) {
  const order = [...costs].sort((a, b) => a.ms.median - b.ms.median || a.error - b.error);
  let least = Infinity;
  return order.filter((cost) => cost.error < least && ((least = cost.error), true));
}

// One group of a trade-off: its points, and the line of its Pareto front. `labels` are the places of the points' labels so far;
// one that would overlap another is left out.
function drawGroup(root, costs, {x, errorAt, color, labels}) {
  const steps = paretoFront(costs).map((cost, k) => k === 0
    ? `M${x.at(cost.ms.median)},${errorAt(cost)}` : `H${x.at(cost.ms.median)}V${errorAt(cost)}`);
  root.append(svg("path", {d: steps.join(""), fill: "none", stroke: color, "stroke-width": 1.6, opacity: 0.75}));
  for (const cost of costs) {
    const {p10, median, p90} = cost.ms, y = errorAt(cost);
    root.append(line(x.at(p10), y, x.at(p90), y, {stroke: color, "stroke-width": 1.4}),
      marker(tierIndex(cost.tier), x.at(median), y, color));
    const place = {x: x.at(median), y: y - 9};
    if (labels.some((other) => Math.abs(other.x - place.x) < 50 && Math.abs(other.y - place.y) < 11)) continue;
    labels.push(place);
    root.append(label(place.x, place.y, cost.tier, {fill: color, "font-size": 10, "text-anchor": "middle"}));
  }
}

// Time against error. A group is {text, costs}; `bound` is {error, text}, a line across the chart.
function drawTradeOff(width, {groups, bound, floor, margin, xTitle, yTitle}) {
  const costs = groups.flatMap((group) => group.costs);
  const area = frame(width, [
    ...groups.map(({text}, i) => ({text, sign: stroke(COLORS[i % COLORS.length])})),
    ...tierNames().map((tier, i) => ({text: `tier ${tier}`, sign: dot(i, "#333")})),
  ]);
  const {root, box} = area, drawn = (cost) => Math.max(floor, cost.error);
  const x = logScale(costs.flatMap(({ms}) => [ms.p10, ms.p90]), box.left, box.right, width / 70);
  const y = logScale([...costs.map(drawn), bound.error], box.bottom, box.top, 10, margin);
  xAxis(area, x, xTitle);
  yAxis(area, y, yTitle);
  root.append(line(box.left, y.at(bound.error), box.right, y.at(bound.error), {stroke: "#b00020", "stroke-dasharray": "5 4"}),
    label(box.right, y.at(bound.error) - 5, bound.text, {"text-anchor": "end", fill: "#b00020"}));
  const labels = [];
  groups.forEach((group, i) => drawGroup(root, group.costs,
    {x, errorAt: (cost) => y.at(drawn(cost)), color: COLORS[i % COLORS.length], labels}));
  return root;
}

function drawTimeAgainstError(width) {
  const rows = verified(), sizes = [...new Set(rows.map(size))];
  const groups = sizes.map((words) => {
    const group = rows.filter((row) => size(row) === words);
    return {text: `${group[0].megapixels} MP, ${words}`, costs: group.map(frameCost)};
  });
  return drawTradeOff(width, {groups, bound: {error: 0.5, text: "0.5 code"}, floor: ERROR_FLOOR, margin: 3,
    xTitle: "device time of a frame, ms (median, p10 .. p90)", yTitle: "largest error, codes"});
}

function drawBakes(width) {
  const rows = verifiedBakes(), names = [...new Set(rows.map((row) => row.panorama))];
  const groups = names.map((name) => {
    const group = rows.filter((row) => row.panorama === name);
    return {text: `${name}, cube map of ${group[0].size}`, costs: group.map(bakeCost)};
  });
  return drawTradeOff(width, {groups, bound: {error: BAKE_BOUND, text: "2 %, the bound of standard"},
    floor: BAKE_ERROR_FLOOR, margin: 2, xTitle: "device time of a bake, ms (median, p10 .. p90)",
    yTitle: "largest relative error of a level"});
}

function drawTimePerMegapixel(width) {
  const points = timed().map((row) => {
    const megapixels = row.width * row.height * 1e-6, {p10, median, p90} = row.device_ms;
    return {tier: row.tier, megapixels, p10: p10 / megapixels, median: median / megapixels, p90: p90 / megapixels};
  });
  const area = frame(width,
    tierNames().map((tier, i) => ({text: `tier ${tier}`, sign: dot(i, COLORS[i % COLORS.length])})));
  const {root, box} = area;
  const x = logScale(points.map((point) => point.megapixels), box.left, box.right, width / 70);
  const y = logScale(points.flatMap((point) => [point.p10, point.p90]), box.bottom, box.top, 9);
  xAxis(area, x, "frame size, megapixels");
  yAxis(area, y, "device time, ms per megapixel (median, p10 .. p90)");
  for (const tier of tierNames()) {
    const color = COLORS[tierIndex(tier) % COLORS.length], row = points.filter((point) => point.tier === tier);
    root.append(svg("polyline", {
      points: row.map((point) => `${x.at(point.megapixels)},${y.at(point.median)}`).join(" "),
      fill: "none", stroke: color, "stroke-width": 1.6,
    }));
    for (const point of row) {
      const at = x.at(point.megapixels);
      root.append(line(at, y.at(point.p10), at, y.at(point.p90), {stroke: color, "stroke-width": 1.4}),
        marker(tierIndex(tier), at, y.at(point.median), color));
    }
  }
  return root;
}

// The rows of the largest size at which the most tiers have `key`.
function rowsToCompare(rows) {
  const sizes = [...new Set(rows.map((row) => row.megapixels))].sort((a, b) => a - b);
  const groups = sizes.map((megapixels) => rows.filter((row) => row.megapixels === megapixels));
  return groups.reduce((best, group) => (group.length >= best.length ? group : best), []);
}

function stageRows() {
  const rows = rowsToCompare(timed());
  const fastest = Math.min(...rows.map((row) => row.device_ms.median));
  return rows.filter((row) => row.device_ms.median <= BEYOND_SCALE * fastest);
}

function drawStages(width) {
  const rows = stageRows(), names = [...new Set(rows.flatMap((row) => row.stages.map((stage) => stage.name)))];
  const total = (row) => row.stages.reduce((sum, stage) => sum + stage.ms.median, 0);
  const items = names.map((text, i) => ({text, sign: (x, y) =>
    [svg("rect", {x: x - 6, y: y - 6, width: 12, height: 12, fill: COLORS[i % COLORS.length]})]}));
  const signs = legend(items, 8, width - 16), left = 84, right = width - 70, bar = 30, top = signs.height + 10;
  const height = top + rows.length * (bar + 14);
  const scale = (right - left) / Math.max(...rows.map(total));
  const root = svg("svg", {
    xmlns: "http://www.w3.org/2000/svg", viewBox: `0 0 ${width} ${height}`, width, height,
    "font-family": "system-ui, sans-serif", "font-size": 12, role: "img",
  }, svg("rect", {width, height, fill: "#fff"}), ...signs.elements);
  rows.forEach((row, i) => {
    const y = top + i * (bar + 14);
    let x = left;
    root.append(label(left - 8, y + bar / 2 + 4, row.tier, {"text-anchor": "end"}));
    for (const stage of row.stages) {
      const wide = stage.ms.median * scale;
      root.append(svg("rect", {x, y, width: wide, height: bar, fill: COLORS[names.indexOf(stage.name) % COLORS.length]},
        svg("title", {}, `${stage.name}: ${short(stage.ms.median)} ms`)));
      x += wide;
    }
    root.append(label(x + 7, y + bar / 2 + 4, `${short(total(row))} ms`));
  });
  return root;
}
