// Forms that are sent without leaving the page. The form stays an ordinary form: the same fields go to the same
// address, the server checks them once, and without this script the browser posts it by itself. The script adds
// that the wish waits out a restart, that faults appear at their fields, and that the typed text is never lost.

import { redraw } from "./redraw.js";
import { numberOf, settled } from "./receipts.js";
import { newKey, send, wasDone } from "./send.js";
import { offerUndo, sayThere } from "./toast.js";
import { say } from "./words.js";

const refusedSafe = new Set(); // forms that were refused while the server only reads
const FRESH = ["description", "amount", "category"]; // of an entry: what is empty when the next one begins
const wishes = new WeakMap(); // form -> its wish, in a browser without storage

const opened = document.getElementById("entry-now")?.dataset.seen; // what the entry was when its page was opened

/** Take over every form that says so, also those that are drawn later. */
export function watchForms() {
  document.addEventListener("submit", (event) => {
    const form = event.target;
    if (!form.matches("form[data-send]")) return;
    event.preventDefault();
    void submit(form);
  });
  document.addEventListener("hc:receipt", ({ detail }) => heard(detail));
  document.addEventListener("ledger:drawn", showChange);
  document.addEventListener("hc:state", ({ detail }) => { if (detail.text === null && !detail.safe) openAgain(); });
}

/** Tell a sentence below a form. `kind` is "", "good" or "wrong". */
export function tell(form, sentence, kind = "") {
  const said = form.querySelector("[data-said]");
  said.textContent = sentence;
  said.className = `said ${kind}`;
}

async function submit(form) {
  const field = form.elements._idempotency_key;
  const sent = fieldsOf(form);
  if (form.dataset.busy) return pressedTwice(form, sent);
  busy(form, true);
  refusedSafe.delete(form);
  clearFaults(form);
  tell(form, say("sending"));
  if (!await isFirst(form, field, sent)) return busy(form, false);
  field.value = keyFor(form, sent, field.value);
  const answer = await send(form.action, {
    body: sent,
    type: "application/x-www-form-urlencoded",
    key: field.value,
    onWaiting: () => tell(form, say("waiting")),
    onPromise: (outcome) => promised(form, field.value, outcome),
  });
  ended(form, field, sent, answer);
}

// Another text is another wish and needs another key. What was sent before it, and got no answer that says what became
// of it, may have been done all the same: the ledger is asked first, or a person who corrects it has both without a word.
async function isFirst(form, field, sent) {
  const open = wishOf(form);
  if (!open || open.sent === sent) return true;
  const done = open.undone ? false : await wasDone(open.key, () => tell(form, say("waiting")));
  if (done === undefined) {
    tell(form, say("unsaid"), "wrong");
    return false;
  }
  forget(form);
  if (field.value === open.key) field.value = newKey();
  if (done) {
    tell(form, say("first_saved"), "wrong");
    void redraw();
  }
  return !done;
}

function ended(form, field, sent, answer) {
  busy(form, false);
  if (answer.status < 500) forget(form);
  if (answer.status >= 200 && answer.status < 300) saved(form, field, sent, answer.body);
  else refused(form, field, answer);
}

function promised(form, key, outcome) {
  if (form.dataset.promised === key + outcome) return; // also where it was pressed twice since
  form.dataset.promised = key + outcome;
  tell(form, sayKept(key, outcome));
}

/** What is said of a wish that was promised: the window may be closed; or that a person has to decide (on the card). */
export function sayKept(key, outcome) {
  if (outcome === "ask") return say("receipt.R5");
  if (outcome === "set_aside") return `${say("receipt.set_aside")} · ${say("receipt.set_aside.line")}`;
  return `${say("receipt.R1b.line")} ${say("receipt.R1c", { id: numberOf(key) })}`;
}

function pressedTwice(form, sent) {
  const wish = wishOf(form);
  if (form.dataset.promised && wish?.sent === sent) tell(form, say("receipt.R14", { id: numberOf(wish.key) }));
}

// A page that was loaded again while its wish was on its way: if it was promised, its end is told here as ever. If not,
// nothing is sent; whoever sends the same once more means the same wish.
async function goOn(form, wish) {
  const field = form.elements._idempotency_key;
  field.value = wish.key;
  busy(form, true);
  const answer = await settled(wish.key, (outcome) => promised(form, wish.key, outcome));
  if (answer) ended(form, field, wish.sent, answer);
  else busy(form, false);
}

function heard({ key }) {
  for (const form of document.querySelectorAll("form[data-send]:not([data-busy])")) {
    const wish = wishOf(form);
    if (wish?.key === key) void goOn(form, wish);
  }
}

function saved(form, field, sent, body) {
  const unchanged = fieldsOf(form) === sent;
  field.value = newKey();
  form.dispatchEvent(new CustomEvent("hc:sent", { bubbles: true }));
  if (form.dataset.send === "go") {
    if (body.said) sayThere(body.said);
    location.assign(body.location ?? "/register"); // what was looked up is the ledger's own answer, which leads nowhere
    return;
  }
  // What was typed while the wish was on its way is the next one, and stays.
  if (unchanged) empty(form);
  form.closest("details")?.removeAttribute("open");
  if (body.undo) {
    tell(form, "");
    offerUndo(body, form, () => { if (unchanged) writeAgain(form, sent); });
  } else tell(form, body.said ?? say("receipt.done"), "good");
  void redraw();
}

// Nothing is sent by itself: days may have gone, and a person decides whether the wish still holds.
function openAgain() {
  for (const form of refusedSafe) if (form.isConnected) tell(form, say("safe_over"));
  refusedSafe.clear();
}

function refused(form, field, { status, body }) {
  // A refusal is remembered under its key; what is corrected is another wish. A fault of the server's own is not an
  // answer to the wish: its key stays, so that pressing again can't book it twice.
  if (status < 500) field.value = newKey();
  else if (body.outcome === "not_done") remember(form, { ...wishOf(form), undone: true });
  if (body.type === "/problems/entry-changed") void catchUp();
  const faults = body.faults ?? {};
  let first = null;
  for (const [name, sentence] of Object.entries(faults)) {
    const input = form.elements[name];
    const place = form.querySelector(`[data-fault="${CSS.escape(name)}"]`);
    if (!input || !place) continue;
    place.textContent = sentence;
    input.setAttribute("aria-invalid", "true");
    first ??= input;
  }
  const isSafe = body.type === "/problems/safe-mode";
  if (isSafe) refusedSafe.add(form);
  const unsaved = isSafe && body.outcome === "not_done" ? ` ${say("safe_kept")}` : "";
  tell(form, first ? "" : (body.detail ?? say("unsaid")) + unsaved, "wrong");
  first?.focus();
}

// Somebody else was first: what stands now is shown, and only then has this page seen it. What was typed stays.
async function catchUp() {
  if (!await redraw()) return;
  const { seq } = document.getElementById("entry-now").dataset;
  for (const seen of document.querySelectorAll("[name=expected_seq]")) seen.value = seq;
}

function showChange() {
  const now = document.getElementById("entry-now");
  if (now) now.hidden = now.dataset.seq === opened;
}

// A page that is loaded again while a wish is on its way has a fresh key, and the typed text comes back. Whoever sends
// the same once more means the same wish: it keeps the key that nobody has answered yet.
function keyFor(form, sent, fresh) {
  const open = wishOf(form);
  const key = open?.sent === sent ? open.key : fresh;
  remember(form, { key, sent });
  return key;
}

function remember(form, wish) {
  wishes.set(form, wish);
  try {
    sessionStorage.setItem(nameOf(form), JSON.stringify(wish));
  } catch {
    // No storage in this browser: a reload in an outage is then a new wish.
  }
}

function wishOf(form) {
  try {
    return JSON.parse(sessionStorage.getItem(nameOf(form)));
  } catch {
    return wishes.get(form) ?? null; // no storage, or not ours
  }
}

function forget(form) {
  wishes.delete(form);
  try {
    sessionStorage.removeItem(nameOf(form));
  } catch {
    // Nothing was kept.
  }
}

function nameOf(form) {
  return `wish:${form.getAttribute("action")}`;
}

function fieldsOf(form) {
  const data = new FormData(form);
  data.delete("_idempotency_key"); // it goes in the header
  return new URLSearchParams(data).toString();
}

function empty(form) {
  const stays = new Set(["kind", "account", "to", "date", "type", "currency"]);
  let first = null;
  for (const input of form.elements) {
    if (!input.name || input.type === "hidden" || stays.has(input.name)) continue;
    input.value = "";
    first ??= input;
  }
  if (form.contains(document.activeElement)) first?.focus();
}

// What was taken back is there to be corrected, unless somebody has begun to write the next one.
function writeAgain(form, sent) {
  if ([...new FormData(form)].some(([name, value]) => FRESH.includes(name) && value)) return;
  for (const [name, value] of new URLSearchParams(sent)) if (form.elements[name]) form.elements[name].value = value;
}

function clearFaults(form) {
  for (const place of form.querySelectorAll("[data-fault]")) place.textContent = "";
  for (const input of form.querySelectorAll("[aria-invalid]")) input.removeAttribute("aria-invalid");
}

function busy(form, is) {
  if (is) form.dataset.busy = "1";
  else {
    delete form.dataset.busy;
    delete form.dataset.promised;
  }
  form.querySelector("button:not([type=button])")?.setAttribute("aria-disabled", String(is));
}
