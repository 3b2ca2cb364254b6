// What a cell of the table tells when it is pointed at: its learning curves and the numbers behind its mean.

const SVG = "http://www.w3.org/2000/svg";

function make(name, attributes = {}, ...content) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...content);
  return node;
}

function draw(name, attributes = {}, ...content) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null) node.setAttribute(key, value);
  node.append(...content);
  return node;
}

function scales(frame, axes) {
  const [firstStep, lastStep] = axes.steps;
  const [lowest, highest] = axes.scores;
  const { width, height, left, right, top, bottom } = frame;
  return {
    x: (step) => left + ((width - left - right) * (step - firstStep)) / (lastStep - firstStep),
    y: (score) => height - bottom - ((height - top - bottom) * (score - lowest)) / (highest - lowest),
  };
}

function panelFrame(frame, axes, { x, y }, demonstration) {
  const { width, height, left, right, top, bottom } = frame;
  const floor = height - bottom;
  const parts = [];
  const across = (score, kind) =>
    parts.push(draw("line", { x1: left, x2: width - right, y1: y(score), y2: y(score), class: kind }));
  across(0, "reference");
  across(100, "reference");
  if (demonstration !== null) across(demonstration, "demonstration");
  parts.push(draw("path", { d: `M${left} ${top}V${floor}H${width - right}`, class: "axis" }));
  for (const [score, label] of axes.scoreTicks) {
    parts.push(draw("line", { x1: left - 3, x2: left, y1: y(score), y2: y(score), class: "axis" }));
    parts.push(draw("text", { x: left - 6, y: y(score) + 3.2, "text-anchor": "end" }, label));
  }
  for (const [step, label] of axes.stepTicks) {
    parts.push(draw("line", { x1: x(step), x2: x(step), y1: floor, y2: floor + 3, class: "axis" }));
    parts.push(draw("text", { x: x(step), y: floor + 14, "text-anchor": "middle" }, label));
  }
  const middle = (top + floor) / 2;
  parts.push(
    draw("text", { x: (left + width - right) / 2, y: height - 4, "text-anchor": "middle", class: "axis-label" }, "gradient steps"),
    draw("text", { x: 9, y: middle, "text-anchor": "middle", transform: `rotate(-90 9 ${middle})`, class: "axis-label" }, "score"),
  );
  return parts;
}

// A line through the known scores; it is broken where one is missing.
function path(steps, scores, { x, y }) {
  let pen = "M";
  let d = "";
  scores.forEach((score, index) => {
    if (score === null) {
      pen = "M";
      return;
    }
    d += `${pen}${x(steps[index]).toFixed(1)} ${y(score).toFixed(1)}`;
    pen = "L";
  });
  return d;
}

function cellCurves(evidence, row, column, cell) {
  const { frame } = evidence;
  const scale = scales(frame, row.axes);
  const { colour } = evidence.columns[column];
  const steps = cell.curve.steps ?? row.steps;
  const seeds = cell.curve.seeds.map((scores) => draw("path", { d: path(steps, scores, scale), stroke: colour, class: "seed-line" }));
  const mean = draw("path", { d: path(steps, cell.curve.means, scale), stroke: colour, class: "mean-line" });
  const crosses = cell.curve.diverged.map((step) =>
    draw("path", { d: `M${scale.x(step) - 4} ${scale.y(0) - 4}l8 8m0 -8l-8 8`, stroke: colour, class: "cross" }),
  );
  const count = cell.curve.seeds.length;
  const label = `Score against gradient steps: ${count} ${count === 1 ? "seed" : "seeds"} thin, their mean thick.`;
  return draw(
    "svg",
    { viewBox: `0 0 ${frame.width} ${frame.height}`, role: "img", "aria-label": label },
    ...panelFrame(frame, row.axes, scale, row.demonstration),
    ...seeds,
    mean,
    ...crosses,
  );
}

// As `short_number` in Python: two digits and a power of ten from a million on.
function decimals(value, digits) {
  if (Math.abs(value) >= 1e6) return value.toExponential(1).replace("e+", "e").replace("-", "−");
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? (0).toFixed(digits) : text).replace("-", "−");
}

function cellNumbers(evidence, cell) {
  const list = make("dl");
  const say = (name, ...content) => list.append(make("div", {}, make("dt", {}, name), " ", make("dd", {}, ...content)));
  say("n", `${cell.seeds.length} ${cell.seeds.length === 1 ? "seed" : "seeds"}`);
  if (cell.mean !== null) {
    say("mean", decimals(cell.mean, 2));
    say("std", cell.std === null ? "none: one seed" : decimals(cell.std, 2));
  }
  if (cell.interval) {
    const [low, high] = cell.interval;
    say(`${Math.round(evidence.level * 100)}% t-interval`, `[${decimals(low, 2)}, ${decimals(high, 2)}]`);
  }
  if (cell.seeds.length) {
    const scores = cell.seeds.map((seed, place) => `seed ${seed}: ${decimals(cell.scores[place], 2)}`);
    say("scores", scores.join(", "));
  }
  if (cell.diverged.length) say("diverged, counted as 0", `seed ${cell.diverged.join(", ")}`);
  if (cell.failed.length) say("failed, not counted", `seed ${cell.failed.join(", ")}`);
  return list;
}

// Fills the panel with what is known of a cell; false where there is nothing to tell.
function describeCell(evidence, panel, rowIndex, column) {
  const row = evidence.rows[rowIndex];
  const cell = row.cells[column];
  if (!cell) return false;
  const heading = make("h3", {}, make("bdi", {}, evidence.columns[column].label), " on ", make("bdi", {}, row.task));
  panel.replaceChildren(heading);
  if (cell.curve) panel.append(cellCurves(evidence, row, column, cell));
  panel.append(cellNumbers(evidence, cell));
  return true;
}
