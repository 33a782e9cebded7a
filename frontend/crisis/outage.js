// The life of one outage as a page sees it: what is shown, as a table of moves.
//
// Pure: a view and an event give the next view, time is an argument (milliseconds that only grow). Every event has
// its cell in every mode, so nothing can arrive for which nobody thought. The view says only what is known; the
// words are chosen in wording.js, and the screens are moved in client.js and recovery.js.

export const SHORT_STAY_MS = 5000;
export const RESULT_STAY_MS = 8000;
const AGAIN_STAY_MS = 3000;
const LONG_S = 1;     // history says it takes at least this long: no reason to wait with the overlay
const BRIEF_MS = 1000;  // history says it is usually over by then: an overlay would only flash

export const CALM = Object.freeze({
  mode: "calm",     // calm | sign (strip) | card (overlay) | result (card, not modal) | short (strip) | lost | again
                    // | unsound (card, not modal) | out (bar: signed out)
  frame: null,      // the last state frame
  back: null,       // {outage_ms: null if nobody measured it, verified: true | null}
  gap_ms: 0,        // how long our own line was gone
  silent: false,    // of a lost line: nobody refused, nobody answered
  heeded: false,    // that the ledger is not whole was read and put aside
  begun_ms: 0,      // when the outage began, on our clock
  due_ms: Infinity,  // when `tick` means something
  reached: {},      // stage -> milliseconds after the beginning
  overlay_after_ms: 400,
});

const stays = (view) => view;
const calms = ({ frame, overlay_after_ms, heeded }) => ({ ...CALM, frame, overlay_after_ms, heeded });

/** Whether a person has to act before anything goes on: nobody is trying any more. */
export function isFinal(frame) {
  return frame.text === "R8" || frame.text === "OFF";
}

/** Whether it takes longer than it usually does. */
export function isLate(frame) {
  return frame.text === "R7" || frame.text === "R7b";
}

/** Whether it was asked for and may be over before anybody notices: nothing is said of it yet. */
export function isQuiet(view) {
  return view.mode === "sign" && view.frame.planned && !isFinal(view.frame);
}

function isLong(frame) {
  return isFinal(frame) || isLate(frame) || (!frame.planned && frame.eta !== null && frame.eta.low_s >= LONG_S);
}

function withStage(view, frame, now_ms) {
  // The guard knows when it began; what was shown must never run backwards.
  const begun_ms = Math.min(view.begun_ms, now_ms - frame.elapsed_ms);
  const reached = frame.stage === null || frame.stage in view.reached
    ? view.reached
    : { ...view.reached, [frame.stage]: now_ms - begun_ms };
  return { ...view, frame, begun_ms, reached };
}

function begins(view, frame, now_ms) {
  const { gap_ms } = view;
  const begun_ms = now_ms - gap_ms;
  const fresh = { ...calms(view), heeded: false, mode: "sign", gap_ms, begun_ms, due_ms: now_ms + view.overlay_after_ms };
  return goesOn(fresh, frame, now_ms);
}

// Put aside while a person had to act: once somebody tries again, it is an outage like any other.
function resumes(view, frame, now_ms) {
  return isFinal(view.frame) && !isFinal(frame) ? begins(view, frame, now_ms) : goesOn(view, frame, now_ms);
}

function goesOn(view, frame, now_ms) {
  const followed = withStage(view, frame, now_ms);
  const isBrief = !frame.planned && frame.eta !== null && frame.eta.high_s * 1000 <= BRIEF_MS;
  const due_ms = isBrief ? Math.max(view.due_ms, followed.begun_ms + BRIEF_MS) : view.due_ms;
  const next = { ...followed, due_ms };
  const heardBefore = view.frame !== null && view.frame.text === frame.text;
  return isLong(frame) && !(isFinal(frame) && heardBefore) ? { ...next, mode: "card" } : next;
}

// The guard's number is that of the core. Where our own line was gone too, that is what was seen here.
function lengthOf(view, told_ms, now_ms) {
  if (!view.gap_ms) return told_ms;
  const own_ms = view.begun_ms ? now_ms - view.begun_ms : view.gap_ms;
  return Math.max(told_ms ?? 0, own_ms, view.gap_ms);
}

function ends(mode, stay_ms) {
  return (view, said, now_ms) => {
    const isBack = said.type === "back";
    const frame = isBack ? view.frame : said;
    if ((isBack ? said.verified : frame.sound) === false) return doubts({ ...view, frame });
    const back = isBack
      ? { outage_ms: lengthOf(view, said.outage_ms, now_ms), verified: said.verified }
      : view.back ?? { outage_ms: now_ms - view.begun_ms, verified: null };
    return { ...view, mode, frame, back, due_ms: now_ms + stay_ms };
  };
}

function verifies(stay_ms) {
  return (view, said, now_ms) => (said.ok
    ? { ...view, back: { ...view.back, verified: true }, due_ms: now_ms + stay_ms } : doubts(view));
}

// That the ledger is not whole goes away by a reader's hand alone, or by a proof that it is.
const doubts = (view) => ({ ...calms(view), mode: "unsound" });
const learns = (view, said) => (said.ok ? view : doubts(view));
const heeds = (view) => ({ ...calms(view), heeded: true });
const heals = (view, said) => (said.ok ? calms(view) : view);
const hears = (view, frame) => (frame.sound === true ? { ...calms(view), frame } : { ...view, frame });

// Who was told that the server is being switched off knows why nobody answers any more.
const loses = (view, said) => (view.frame?.text === "OFF" ? view
  : { ...calms(view), mode: "lost", silent: said.silent === true });
function knows(view, frame) {
  const next = { ...view, frame, gap_ms: 0, heeded: view.heeded && frame.sound !== true };
  return frame.sound === false && !view.heeded ? doubts(next) : next;
}
const finds = (view, frame, now_ms) => (frame.sound === false && !view.heeded ? doubts({ ...view, frame })
  : { ...calms(view), frame, gap_ms: view.gap_ms, mode: "again", due_ms: now_ms + AGAIN_STAY_MS });
const short = ends("short", SHORT_STAY_MS);
const result = ends("result", RESULT_STAY_MS);
// Nobody noticed: an outage that was asked for and not shown needs no end either.
const fades = (view, said, now_ms) => (isQuiet(view) && (said.verified ?? said.sound) !== false
  ? { ...calms(view), frame: said.type === "back" ? view.frame : said } : short(view, said, now_ms));
const passes = (view, said, now_ms) => (said.planned && !view.gap_ms && said.verified !== false ? view
  : short(view, said, now_ms));
const rises = (view) => ({ ...view, mode: "card", due_ms: Infinity });
// Put aside by the reader, which only a final card can be: the strip goes on saying it.
const lowers = (view) => (isFinal(view.frame) ? { ...view, mode: "sign", due_ms: Infinity } : view);

// Whoever is signed out is told nothing of the server until it knows him again.
const signsOut = (view) => ({ ...calms(view), mode: "out", frame: null });

export const MOVES = {
  calm: { down: begins, serving: knows, back: passes, verified: learns, lost: loses, out: signsOut, tick: stays, dismiss: stays },
  sign: { down: resumes, serving: fades, back: fades, verified: stays, lost: loses, out: signsOut, tick: rises, dismiss: stays },
  card: { down: goesOn, serving: result, back: result, verified: stays, lost: loses, out: signsOut, tick: stays, dismiss: lowers },
  result: {
    down: begins, serving: knows, back: result, verified: verifies(RESULT_STAY_MS), lost: loses, out: signsOut, tick: calms,
    dismiss: calms,
  },
  short: {
    down: begins, serving: knows, back: short, verified: verifies(SHORT_STAY_MS), lost: loses, out: signsOut, tick: calms,
    dismiss: calms,
  },
  unsound: { down: begins, serving: hears, back: short, verified: heals, lost: loses, out: signsOut, tick: stays, dismiss: heeds },
  lost: { down: begins, serving: finds, back: short, verified: learns, lost: stays, out: signsOut, tick: stays, dismiss: stays },
  again: { down: begins, serving: knows, back: short, verified: learns, lost: loses, out: signsOut, tick: calms, dismiss: calms },
  out: { down: begins, serving: knows, back: stays, verified: learns, lost: loses, out: stays, tick: stays, dismiss: stays },
};

/** The view after an event: `lost`, `out`, `tick`, `dismiss`, or a frame of the gateway. A frame of a kind that this
    script does not know changes nothing, because a newer gateway may say more. */
export function next(view, said, now_ms) {
  if (said.type === "hello") {
    return { ...view, overlay_after_ms: said.overlay_after_ms, gap_ms: Math.max(view.gap_ms, said.gap_ms ?? 0) };
  }
  const kind = said.type === "state" ? (said.text === null ? "serving" : "down") : said.type;
  if (kind === "tick" && now_ms < view.due_ms) return view;
  const move = MOVES[view.mode][kind];
  return move ? move(view, said, now_ms) : view;
}
