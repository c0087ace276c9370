// Elements, tables and numbers of the report's page.
"use strict";

const report = JSON.parse(document.getElementById("report").textContent);

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
const html = (name, attributes = {}, ...children) => fill(document.createElement(name), attributes, children);
const svg = (name, attributes = {}, ...children) =>
  fill(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);
const paragraph = (text) => html("p", {}, text);

// Three significant digits; infinities and NaN are words already.
function short(value, digits = 3) {
  if (typeof value !== "number") return String(value);
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  if (magnitude < -4 || magnitude > 6) return value.toExponential(digits - 1);
  return value.toFixed(Math.max(0, digits - 1 - magnitude));
}

const size = (row) => `${row.width}x${row.height}`;
const count = (value) => ({content: String(value), number: true});
const number = (value, digits) => ({content: short(value, digits), number: true, bad: typeof value === "string"});
const ratio = (value) => ({content: `${short(value)}x`, number: true});
const message = (text, columns, bad = false) => ({content: text, columns, bad});

// "median (p10 .. p90)"; a single frame has only its median.
function spread(times) {
  const parts = [html("b", {}, short(times.median))];
  if (times.p10 !== times.p90) {
    parts.push(html("span", {class: "quiet"}, ` (${short(times.p10)} .. ${short(times.p90)})`));
  }
  return html("span", {}, ...parts);
}
const spreadCell = (times) => ({content: spread(times), number: true});

// A cell is a text, an element, or {content, number, bad, columns}.
function table(heads, rows) {
  const asCell = (cell) => (typeof cell === "string" || cell instanceof Node ? {content: cell} : cell);
  const cells = rows.map((row) => row.map(asCell));
  const length = (cell) => (cell.content.textContent || cell.content).length;
  const width = (cell) => (length(cell) > 60 ? "very-long" : length(cell) > 24 ? "long" : "");
  const kind = (cell) => `${cell.number ? "number" : width(cell)} ${cell.bad ? "bad" : ""}`.trim();
  const isNumber = (column) => cells.some((row) => row[column] && row[column].number);
  const head = heads.map((text, column) => html("th", isNumber(column) ? {class: "number"} : {}, text));
  const body = cells.map((row) => html("tr", {}, ...row.map((cell) =>
    html("td", {class: kind(cell), ...(cell.columns ? {colspan: cell.columns} : {})}, cell.content))));
  const all = html("table", {}, html("tbody", {}, ...body));
  if (heads.length) all.prepend(html("thead", {}, html("tr", {}, ...head)));
  return html("div", {class: "scroll"}, all);
}
