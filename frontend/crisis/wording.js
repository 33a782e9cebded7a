// From what is known to sentences: which texts are said of a view, and which are not.
//
// Pure, and the only place where the script decides to claim something. A claim is made from its fact alone
// (FACTS in catalogue_crisis.py names each): without the fact the neutral sentence stands, or none.

import { isFinal, isLate, isQuiet } from "./outage.js";

const TITLES = { R8: "title.stopped", OFF: "title.off" };
const HEADS = { R1: "R1", R2: "R2", R7: "R7", R7b: "R7", R8: "R8", OFF: "OFF" };
const STATUS_EVERY_S = 10;
const SAMPLES_MIN = 5;  // with fewer there is no estimate; with more and none, what was promised is over

/** A text with its values in place of the names in braces. */
export function fill(text, values) {
  return text.replace(/\{(\w+)\}/g, (_, name) => String(values[name]));
}

/** Seconds as people say them: one decimal while it says something. */
export function seconds(ms) {
  return ms < 9950 ? (Math.max(ms, 100) / 1000).toFixed(1) : String(Math.round(ms / 1000));
}

function headOf(frame, words) {
  return words[HEADS[frame.text] ?? "R1"];
}

function promises(frame, words) {
  switch (frame.text) {
    case "R2": return [words["R2.line"], words["R1.line"]];
    case "R7": return [...stageNow(frame, words), ...alerted(frame, words)];
    case "R7b": return [...stageNow(frame, words), words["R7b.line"]];
    case "R8": return [words["R8.line"]];
    case "OFF": return [words["OFF.line"]];
    default: return [words["R1.line"]];
  }
}

// Only a delivery that was confirmed has a time; without one nothing is said of it.
function alerted(frame, words) {
  const at = new Date(frame.alerted_at ?? NaN);
  if (Number.isNaN(at.getTime())) return [];
  const [hours, minutes] = [at.getHours(), at.getMinutes()].map((part) => String(part).padStart(2, "0"));
  return [fill(words["R7.alerted"], { t: `${hours}:${minutes}` })];
}

function stageNow(frame, words) {
  return frame.stage === null ? [] : [fill(words["R7.stage"], { stage: stageName(frame, frame.stage, words) })];
}

// A restart that was asked for finds no problem and stops no broken server.
function stageName(frame, number, words) {
  return (frame.planned && words[`plan.${number}`]) || words[`stage.${number}`];
}

function timing(frame, elapsed_s, words) {
  const elapsed = fill(words.elapsed, { t: elapsed_s });
  const { eta } = frame;
  if (eta === null) return !isLate(frame) && frame.samples < SAMPLES_MIN ? `${words["eta.none"]} · ${elapsed}` : elapsed;
  const usual = eta.low_s < 1 || eta.low_s >= eta.high_s ? "eta.within" : "eta.range";
  return `${fill(words[usual], { a: eta.low_s, b: eta.high_s })} · ${elapsed}`;
}

// Never past the end of the stage that is still going on, so that the bar does not promise what is not there.
function progress(frame, elapsed_s) {
  if (frame.eta === null) return null;
  const share = elapsed_s / Math.max(frame.eta.high_s, 1);
  return Math.min(share, (frame.stage ?? 1) / frame.stages);
}

function stages(view, words) {
  const { frame, reached } = view;
  if (frame.stage === null || isFinal(frame)) return [];
  return Array.from({ length: frame.stages }, (_, index) => {
    const number = index + 1;
    const mark = number < frame.stage ? "done" : number === frame.stage ? "now" : "next";
    const ended_ms = reached[number + 1];
    const took = mark === "done" && number in reached && ended_ms !== undefined;
    return {
      mark, name: stageName(frame, number, words),
      // Not every outage stops at every stage: with nothing to stop, nothing was.
      word: words[mark === "done" && !(number in reached) ? "mark.passed" : `mark.${mark}`],
      took: took ? fill(words.took, { t: seconds(ended_ms - reached[number]) }) : null,
    };
  });
}

// What the gateway holds, and what waits in this page alone: two places, so two sentences. The window is needed for
// what was not promised to outlive it.
function waiting(view, facts, words) {
  const { held, promised = 0 } = view.frame;
  if (isFinal(view.frame) || facts.request) return [];  // beside a form that is not kept, another's promise would read as its own
  const more = [];
  if (promised < held) more.push(words["R1b.open"]);
  else if (promised && facts.receipt) more.push(fill(words.R1c, { id: facts.receipt.slice(-8) }));
  return [[held, "R1b", more], [facts.pending, "R1p", []]].filter(([n]) => n > 0)
    .map(([n, code, more]) => ({ head: fill(words[code], { n }), line: [words[`${code}.line`], ...more].join(" ") }));
}

function downCard(view, facts, now_ms, words) {
  const { frame } = view;
  const elapsed_s = Math.max(0, Math.floor((now_ms - view.begun_ms) / 1000));
  const final = isFinal(frame);
  return {
    head: headOf(frame, words),
    lines: promises(frame, words),
    strong: facts.request ? asked(facts.request, "wait", words) : facts.draft && words[`draft.${facts.draft}`],
    time: final || facts.unheard ? null : timing(frame, elapsed_s, words),
    progress: final ? null : progress(frame, elapsed_s),
    stages: stages(view, words),
    waiting: waiting(view, facts, words),
    details: facts.unheard ? [] : [
      fill(words.state, { phase: words[`phase.${frame.phase}`] ?? words["phase.UNKNOWN"] }),
      ...(frame.incident === null ? [] : [fill(words.incident, { id: frame.incident })]),
      ...(final ? [words[`${frame.text}.next`]] : []),
    ],
    status: [headOf(frame, words), ...(final ? promises(frame, words) : stageNow(frame, words)),
      ...(final || elapsed_s < STATUS_EVERY_S ? [] : [
        fill(words.elapsed, { t: elapsed_s - (elapsed_s % STATUS_EVERY_S) })])].join(" "),
    closes: final, admin: frame.text === "R8" ? words["R8.admin"] : null,
    tone: isLate(frame) || final ? "warn" : "busy",
  };
}

function shortCard(head, lines, tone, strong = null) {
  return {
    head, lines, strong, time: null, progress: null, stages: [], waiting: [], details: [], admin: null,
    status: [head, ...lines].join(" "), closes: true, tone,
  };
}

function resultCard(view, facts, words) {
  const { outage_ms, verified } = view.back;
  const lines = [words[verified ? "R3.verified" : "R3b.line"]];
  if (outage_ms !== null) lines.unshift(fill(words["R3.took"], { t: seconds(outage_ms) }));
  return shortCard(words.R3, lines, "good", askedOf(view, facts, words));
}

// What became of the form that the recovery page answers, and what to do about it `wait`ing or `now`.
function asked(outcome, when, words) {
  return `${words[`${outcome}.line`]} ${words[`${outcome}.${when}`]}`;
}

function askedOf(view, facts, words) {
  return facts.request && asked(facts.request, view.mode === "lost" ? "wait" : "now", words);
}

function shortStrip(view, words) {
  const { outage_ms, verified } = view.back;
  const head = outage_ms === null ? words["R11.back"]
    : outage_ms < 1000
      ? fill(words.R3c, { n: Math.round(outage_ms) })
      : fill(words["R3c.seconds"], { t: seconds(outage_ms) });
  return { head, line: verified ? words["R3c.verified"] : null, tone: "good" };
}

// Nobody refused and nobody answered: then it may be the server as well as the line.
function lostStrip(view, facts, words) {
  const code = view.silent ? "R11.silent" : "R11";
  const kept = facts.alive ? [words["R11.kept"]] : [];
  return { head: words[code], line: [words[`${code}.line`], ...kept].join(" "), tone: "warn" };
}

// Reads only: said for as long as it lasts. Where the ledger itself is the reason, nothing is claimed of what is shown.
function barOf(view, facts, words) {
  const { frame } = view;
  if (view.mode === "out") {
    // What stands in this page alone would be lost with it: then signing in happens beside it.
    const { draft } = facts;
    const line = [draft && words[`draft.${draft}`], words["R12.line"]].filter(Boolean).join(" ");
    return { head: words.R12, line, act: words["R12.do"], beside: draft === "page" };
  }
  if (view.mode === "lost" || !frame || frame.text !== null || !frame.safe) return null;
  const unsound = view.mode === "unsound" || frame.safe === "STORE_CORRUPT" || frame.sound === false;
  const lines = unsound ? [words["R10.safe"], words["R10.line"]] : [words[`R9.${frame.safe}`], words["R9.line"]];
  return { head: words[unsound ? "R10" : "R9"], line: lines.filter(Boolean).join(" "), act: "" };
}

// A request that waits for its trial is no slow server: it takes a moment, and ends by itself.
function slowStrip(view, words) {
  const code = view.frame?.trial > 0 ? "R0.trial" : "R0";
  return { head: words[code], line: words[`${code}.line`], tone: "busy" };
}

function stripOf(view, facts, words) {
  switch (view.mode) {
    case "sign": return isQuiet(view) ? null : { head: headOf(view.frame, words), line: null, tone: isFinal(view.frame) ? "warn" : "busy" };
    case "short": return shortStrip(view, words);
    case "lost": return lostStrip(view, facts, words);
    case "again": return { head: words["R11.back"], line: null, tone: "good" };
    case "calm": return facts.slow ? slowStrip(view, words) : null;
    default: return null;
  }
}

function cardOf(view, facts, strip, now_ms, words) {
  if (view.mode === "card") return downCard(view, facts, now_ms, words);
  if (view.mode === "result") return resultCard(view, facts, words);
  if (view.mode === "unsound" && facts.alive && view.frame?.safe) return null;  // the bar says it, and stays
  if (view.mode === "unsound") return shortCard(words.R10, [words["R10.line"]], "warn", askedOf(view, facts, words));
  // Where no page lives under it, there is nothing that a strip could stay out of the way of.
  return strip && !facts.alive
    ? shortCard(strip.head, strip.line ? [strip.line] : [], strip.tone, askedOf(view, facts, words)) : null;
}

/** What is on the screen for a view.
    `facts`: {pending: count, receipt: key of the last one that waits | null, draft: null | "stored" | "page", slow, alive: the page itself is still there,
    unheard: no frame has come yet, request: null | "not_done" | "unknown" | "keepable" | "doubtful"}. */
export function face(view, facts, now_ms, words) {
  const strip = stripOf(view, facts, words);
  const card = cardOf(view, facts, strip, now_ms, words);
  const bar = barOf(view, facts, words);
  const said = strip ?? bar;
  const status = card ? card.status : said ? [said.head, said.line].filter(Boolean).join(". ") : "";
  const down = view.mode === "card" || (view.mode === "sign" && !isQuiet(view));
  const title = down ? TITLES[view.frame.text] ?? "title.down" : view.mode === "result" || view.mode === "short" ? "title.back" : null;
  return { strip, card, bar, status, title: title && words[title] };
}
