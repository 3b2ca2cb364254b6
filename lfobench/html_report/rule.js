// The highlight rule of lfobench/stats/highlight.py and the words of the footnote, on p-values computed beforehand.

// Adjusted p-values in the order given; rejecting those below alpha is the procedure at level alpha.
function adjusted(pValues, correction) {
  const count = pValues.length;
  if (correction === "none" || count === 0) return [...pValues];
  const order = pValues.map((_, index) => index).sort((one, two) => pValues[one] - pValues[two] || one - two);
  const result = new Array(count);
  if (correction === "holm") {
    let largest = 0;
    order.forEach((place, rank) => {
      largest = Math.max(largest, pValues[place] * (count - rank));
      result[place] = Math.min(largest, 1);
    });
  } else {
    let smallest = Infinity;
    for (let rank = count; rank > 0; rank -= 1) {
      const place = order[rank - 1];
      smallest = Math.min(smallest, (pValues[place] * count) / rank);
      result[place] = Math.min(smallest, 1);
    }
  }
  return result;
}

function competes(column, scope) {
  return scope === "all" || column.kind === "observations";
}

function largest(pValues) {
  return pValues.includes(null) ? null : Math.max(...pValues);
}

// Places by column, 0 the best: of success rates, or of mean scores; level ones share a place.
function placesOf(row, rule) {
  return row.places[rule.test === "fisher" ? "fisher" : "welch"];
}

// The best of a row, those level with them, and the p-value that decides; a word where nothing can be best.
function compareRow(evidence, row, rule) {
  const places = placesOf(row, rule);
  const competing = evidence.columns
    .map((_, index) => index)
    .filter((index) => competes(evidence.columns[index], rule.scope) && places[index] !== null);
  if (competing.length < 2) return { nothing: "unopposed" };
  const taken = [...new Set(competing.map((index) => places[index]))].sort((one, two) => one - two);
  const at = (place) => competing.filter((index) => places[index] === place);
  const best = at(taken[0]);
  if (rule.test === "fisher" && row.cells[best[0]].successes === 0) return { nothing: "all failed" };
  const pairOf = (one, two) =>
    evidence.pairs.findIndex(([first, second]) => first === Math.min(one, two) && second === Math.max(one, two));
  const seconds = best.length > 1 ? [] : at(taken[1]);
  const pairs =
    best.length > 1
      ? best.flatMap((one, place) => best.slice(place + 1).map((two) => pairOf(one, two)))
      : seconds.map((second) => pairOf(best[0], second));
  const against = pairs.map((pair) => row.p[rule.test][pair]);
  const decisive = largest(against);
  const near = decisive === null ? [] : seconds.filter((_, place) => against[place] >= rule.alpha);
  const without = row.withoutSpread[rule.test] ?? [];
  return {
    best,
    level: [...best, ...(near.length ? near : seconds)],
    p: decisive,
    withoutSpread: decisive !== null && pairs.every((pair) => without.includes(pair)),
  };
}

// One outcome per row: { outcome, methods, lost, p }, methods and lost as indices of columns.
function highlights(evidence, rule) {
  const compared = evidence.rows.map((row) => compareRow(evidence, row, rule));
  const tested = compared.filter((row) => !row.nothing && row.p !== null).map((row) => row.p);
  const corrected = adjusted(tested, rule.correction);
  const byHolm = adjusted(tested, rule.correction === "none" ? "holm" : rule.correction);
  let next = 0;
  return compared.map((row) => {
    if (row.nothing) return { outcome: row.nothing, methods: [], lost: [], p: null };
    if (row.p === null) return { outcome: "untested", methods: row.level, lost: [], p: null };
    const { p, withoutSpread } = row;
    const place = next;
    next += 1;
    const alone = row.best.length === 1;
    const lost = alone && row.p < rule.alpha && rule.alpha <= byHolm[place] ? row.best : [];
    if (alone && corrected[place] < rule.alpha) return { outcome: "better", methods: row.best, lost, p, withoutSpread };
    return { outcome: "undecided", methods: row.level, lost, p, withoutSpread };
  });
}

// How often the first of a pair is better, worse, undecided or untested against the second.
function countPair(evidence, pair, rule) {
  const [first, second] = evidence.pairs[pair];
  const rows = evidence.rows.filter((row) => [first, second].every((side) => row.cells[side] && row.cells[side].mean !== null));
  const tested = rows.filter((row) => row.p[rule.test][pair] !== null);
  const corrected = adjusted(tested.map((row) => row.p[rule.test][pair]), rule.correction);
  const counts = { better: 0, worse: 0, undecided: 0, untested: rows.length - tested.length };
  tested.forEach((row, place) => {
    const places = placesOf(row, rule);
    const ahead = places[second] - places[first];
    if (corrected[place] < rule.alpha && ahead !== 0) counts[ahead > 0 ? "better" : "worse"] += 1;
    else counts.undecided += 1;
  });
  return counts;
}

// A number as Python's "g" prints it: six significant digits, no trailing zeros.
function general(value) {
  if (value === 0) return "0";
  const exponent = Number(value.toExponential(5).split("e")[1]);
  if (exponent >= -4 && exponent < 6) return String(Number(value.toPrecision(6)));
  const [digits, power] = value.toExponential(5).split("e");
  return `${Number(digits)}e${power[0]}${power.slice(1).padStart(2, "0")}`;
}

function countedTasks(count) {
  return `${count} ${count === 1 ? "task" : "tasks"}`;
}

function correctedBy(evidence, rule, family) {
  if (rule.correction === "none") return "not corrected for the number of tests";
  return `corrected by ${evidence.words.corrections[rule.correction]} over ${family}`;
}

function testedRows(outcomes) {
  return outcomes.filter((row) => row.p !== null).length;
}

// As `sentence` in lfobench/render/report/verdict.py.
function verdictSentence(evidence, rule, outcomes) {
  const having = (outcome) => outcomes.filter((row) => row.outcome === outcome);
  const parts = [];
  if (having("better").length || having("undecided").length) {
    const named = evidence.columns
      .map((column, index) => [column.label, having("better").filter((row) => row.methods[0] === index).length])
      .filter(([, wins]) => wins > 0)
      .map(([label, wins]) => `${label} on ${wins}`);
    parts.push(`better than the second best: ${named.join(", ") || "none"}`);
    parts.push(`undecided on ${having("undecided").length}`);
  }
  if (having("untested").length) parts.push(`not tested on ${having("untested").length}`);
  if (having("all failed").length) parts.push(`no success at all on ${having("all failed").length}`);
  if (having("unopposed").length) parts.push(`nothing to compare on ${having("unopposed").length}`);
  return `Among ${evidence.words.scopes[rule.scope]}, on ${countedTasks(outcomes.length)}: ${parts.join("; ")}.`;
}

function howDecided(evidence, rule, outcomes) {
  const family = `the ${countedTasks(testedRows(outcomes))} tested`;
  return (
    `Better means ${evidence.words.tests[rule.test]} of best against second best, p < ${general(rule.alpha)}, ` +
    `${correctedBy(evidence, rule, family)}. ` +
    "Undecided means that the test cannot tell the two apart, not that they are equal."
  );
}

function howPairs(evidence, rule) {
  const corrected = correctedBy(evidence, rule, "the tasks of each pair");
  return `${evidence.words.tests[rule.test]}, p < ${general(rule.alpha)}, ${corrected}.`;
}

// What no result of this design could have shown; null where some result could have been significant.
function designNote(evidence, rule, outcomes) {
  const cases = evidence.rows
    .filter((_, index) => outcomes[index].p !== null)
    .map((row) => row.bestCases[rule.test][rule.scope]);
  const factor = rule.correction === "holm" ? cases.length : 1;
  const known = cases.filter((each) => each !== null);
  if (known.some(([smallest]) => smallest * factor < rule.alpha) || known.length === 0) return null;
  const [, printed, scores] = known.reduce((one, two) => (two[0] < one[0] || (two[0] === one[0] && two[2] < one[2]) ? two : one));
  const times = rule.correction === "holm" && cases.length > 1 ? `, times ${cases.length} under Holm` : "";
  return (
    `with ${scores} ${evidence.words.units[rule.test]}s, ${evidence.words.tests[rule.test]} gives at best p = ${printed}${times}, so no row ` +
    "could have come out significant. Use more, or another test."
  );
}

// As `highlight_notes` in lfobench/render/highlight_note.py: [label, text] of every note.
function highlightNotes(evidence, rule, outcomes) {
  const { tests, corrections, scopes } = evidence.words;
  const tested = testedRows(outcomes);
  const level = general(rule.alpha);
  const paired = evidence.paired.includes(rule.test);
  const counts = rule.test === "fisher";
  const corrected =
    rule.correction === "none" ? "" : ` corrected by ${corrections[rule.correction]} over the ${tested} rows tested`;
  let text =
    `the best ${counts ? "success rate" : "mean"} in its row among ${scopes[rule.scope]}, and the second best too unless ` +
    `${tests[rule.test]} between them gives p < ${level}${corrected}. ` +
    `Correction for multiple comparisons: ${corrections[rule.correction]}`;
  const said = {
    untested: `Not tested for want of a second ${evidence.words.units[rule.test]}, both highlighted`,
    unopposed: "Nothing to compare, nothing highlighted",
    "all failed": "No success at all, nothing highlighted",
  };
  const where = (concerned) =>
    concerned.length === outcomes.length ? "every row" : concerned.map((row) => row.task).join(", ");
  for (const [outcome, words] of Object.entries(said)) {
    const concerned = evidence.rows.filter((_, index) => outcomes[index].outcome === outcome);
    if (concerned.length > 0) text += `. ${words}: ${where(concerned)}`;
  }
  if (counts) text += ". Counts are tested because every record says how its episodes ended";
  const notes = [[evidence.labels.highlight, `${text}.`]];
  if (paired) {
    notes.push([
      "Pairs",
      "the test pairs the common start states, each with its mean over seeds. It speaks of other starts of these " +
        "trained policies, not of other training seeds.",
    ]);
  }
  const without = evidence.rows.filter((_, index) => outcomes[index].withoutSpread);
  if (without.length) notes.push(["No spread", `${where(without)}${evidence.words.withoutSpread[rule.test]}`]);
  if (outcomes.some((row) => row.lost.length)) {
    const by = corrections[rule.correction === "none" ? "holm" : rule.correction];
    notes.push([
      evidence.labels.lost,
      `stands out with p < ${level}, and no longer when corrected by ${by} over ${tested} rows.`,
    ]);
  }
  const design = designNote(evidence, rule, outcomes);
  if (design !== null) notes.push(["Design", design]);
  return notes;
}
