// The way of a bank's file: chosen, read, looked at, booked. Each step asks the import's own API and then lets the
// server draw the page again. A file that could not be sent is still in its field and is sent again with the same
// key; a booking that has begun goes on in the server, whatever happens to this page.

import { sayKept, tell } from "./forms.js";
import { redraw } from "./redraw.js";
import { newKey, send } from "./send.js";
import { say } from "./words.js";

const API = "/api/ledger/imports";
const POLL_MS = 2000;
const FILE_BYTES_MAX = 32 << 20;

const upload = document.querySelector("[data-upload]");
const made = document.querySelector("[data-import]");
let looks = Promise.resolve();
let asked = 0; // looks at the file so far
if (upload) watchUpload(upload);
if (made) watchImport(made);

/* Choosing */

function watchUpload(form) {
  const drop = form.querySelector("[data-drop]");
  const file = form.elements.file;
  file.addEventListener("change", () => chosen(form));
  for (const event of ["dragover", "dragleave", "drop"]) {
    drop.addEventListener(event, (happened) => {
      happened.preventDefault();
      drop.classList.toggle("over", event === "dragover");
    });
  }
  drop.addEventListener("drop", (event) => {
    if (!event.dataTransfer.files.length) return;
    file.files = event.dataTransfer.files;
    chosen(form);
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    void read(form);
  });
  form.querySelector("button.primary").disabled = false;
}

function chosen(form) {
  form.querySelector("[data-file-name]").textContent = form.elements.file.files[0]?.name ?? say("import_drop");
  form.elements._idempotency_key.value = newKey();
  lock(form, false);
  tell(form, "");
}

function lock(form, locked) {
  form.querySelector("[data-locked]").hidden = !locked;
  form.elements.password.disabled = !locked;
  if (!locked) form.elements.password.value = "";
}

async function read(form) {
  if (!form.elements.file.files.length) return tell(form, say("import_file_first"), "wrong");
  const answer = await held(form, say("import_reading"), async (options) => {
    const body = new FormData(form);
    const file = await inMemory(form.elements.file.files[0]);
    if (file === null) return { status: 0, body: { detail: say("import_file_gone") } };
    body.set("file", file, file.name);
    body.delete("_idempotency_key");
    return send(API, { body, ...options });
  });
  if (answer === null) return;
  if (answer.status === 201) return location.assign(`/import/${encodeURIComponent(answer.body.id)}`);
  form.elements._idempotency_key.value = newKey();
  tell(form, sentenceOf(answer), "wrong");
  if (answer.body.reason !== "locked" && answer.body.reason !== "wrong-password") return;
  lock(form, true);
  form.elements.password.select();
}

// A wish that waits sends the file again later: what the disk has by then is another file, and a browser refuses it.
// What is too large for the ledger anyway is left where it is.
async function inMemory(file) {
  if (file.size > FILE_BYTES_MAX) return file;
  try {
    return new File([await file.arrayBuffer()], file.name, { type: file.type });
  } catch {
    return null; // moved, changed or taken away since it was chosen
  }
}

/* Looking at it, and booking it */

function watchImport(page) {
  const api = `${API}/${encodeURIComponent(page.dataset.import)}`;
  page.addEventListener("change", (event) => void changed(api, event.target));
  page.addEventListener("change", (event) => {
    if (event.target.name === "again") countAgain(event.target.form);
  });
  document.addEventListener("ledger:drawn", () => {
    const form = page.querySelector("[data-commit]");
    if (form?.elements.again) countAgain(form);
  });
  page.addEventListener("click", (event) => {
    if (event.target.closest("[data-make-account]")) void makeAccount(api, event.target.closest("form"));
  });
  page.addEventListener("submit", (event) => {
    event.preventDefault();
    if (event.target.matches("[data-commit]")) void commit(api, event.target);
  });
  document.addEventListener("ledger:import", ({ detail }) => {
    if (detail.id === page.dataset.import) progress(page, detail);
  });
  // The socket tells it first; this is for a browser whose socket does not come through.
  setInterval(() => {
    if (!document.hidden && stateOf(page) === "committing") void look(api, page);
  }, POLL_MS);
}

function changed(api, field) {
  const form = field.form;
  if (!form?.matches("[data-how]") || field.name.startsWith("new_")) return undefined;
  form.querySelector("[data-new-account]").hidden = form.elements.account.value !== "+";
  if (field.name === "account" && field.value === "+") return form.elements.new_name.focus();
  if ("role" in field.dataset) {
    return preview(api, { mapping: mappingOf(form) });
  }
  if (!field.value && field.name === "account") return undefined;
  return preview(api, { [field.name]: field.value });
}

function mappingOf(form) {
  const columns = JSON.parse(form.dataset.columns);
  const mapping = {};
  for (const { name, value, dataset } of form.querySelectorAll("[data-role]")) {
    mapping[name] = (value && "column" in dataset ? columns[value] : value) || null;
  }
  return mapping;
}

// One after the other: what is chosen while an earlier choice is on its way is looked at next, and drawn with the last.
function preview(api, wish) {
  asked += 1;
  const mine = asked;
  const body = JSON.stringify(wish);
  looks = looks.then(async () => {
    const form = document.querySelector("[data-how]");
    const answer = await sent(form, say("import_reading"), (options) => send(`${api}/preview`, { body, type: "application/json", ...options }));
    if (answer.status >= 300) tell(form, sentenceOf(answer), "wrong");
    else if (mine === asked) await drawn();
  });
  return looks;
}

async function makeAccount(api, form) {
  const body = new URLSearchParams({
    name: form.elements.new_name.value,
    type: form.elements.new_type.value,
    currency: form.elements.new_currency.value,
  }).toString();
  const type = "application/x-www-form-urlencoded";
  const answer = await held(form, say("sending"), (options) => send("/accounts", { body, type, ...options }));
  if (answer === null) return;
  if (answer.status >= 300) return tell(form, Object.values(answer.body.faults ?? {})[0] ?? sentenceOf(answer), "wrong");
  await preview(api, { account: answer.body.id });
}

// What the button says is what is booked: the new rows, with the box ticked those that are there already too.
function countAgain(form) {
  const { fresh, good, ready } = form.dataset;
  const n = Number(form.elements.again.checked ? good : fresh);
  const button = form.querySelector("button.primary");
  button.textContent = n ? say("import_commit", { n }) : say("import_commit_none");
  button.disabled = !ready || !n;
  const skipping = document.getElementById("import-skipping");
  if (skipping) skipping.hidden = form.elements.again.checked;
}

async function commit(api, form) {
  const how = document.querySelector("[data-how]");
  const body = JSON.stringify({ account: how.elements.account.value, skip_duplicates: !form.elements.again?.checked });
  const answer = await held(form, say("sending"), (options) => send(`${api}/commit`, { body, type: "application/json", ...options }));
  if (answer === null) return;
  if (answer.status >= 300) {
    form.elements._idempotency_key.value = newKey();
    return tell(form, sentenceOf(answer), "wrong");
  }
  await drawn();
}

// `waiting`: why it rests, as a frame says it or as a look does; the page has its sentence.
function progress(page, { state, done, total, waiting }) {
  const bar = page.querySelector("#import-bar");
  if (!bar || state !== "committing") {
    if (stateOf(page) !== state) void drawn();
    return;
  }
  const shown = page.querySelector("#import-body").dataset.waiting ?? "";
  if ((waiting?.reason ?? waiting ?? "") !== shown) return void drawn();
  bar.max = total || 1;
  bar.value = done;
  page.querySelector("#import-much").textContent = say("import_progress", { done, total });
}

async function look(api, page) {
  try {
    const response = await fetch(api, { headers: { Accept: "application/json" }, cache: "no-store" });
    if (response.ok) progress(page, await response.json());
  } catch {
    // No server at the moment; the next look, or the socket, will tell.
  }
}

/* What all steps share */

function stateOf(page) {
  return page.querySelector("#import-body").dataset.state;
}

/** Send with the form's key while its button rests; null while an earlier wish of this form is on its way. */
async function held(form, sentence, sending) {
  if (form.dataset.busy) return null;
  form.dataset.busy = "1";
  const answer = await sent(form, sentence, sending);
  delete form.dataset.busy;
  return answer;
}

async function sent(form, sentence, sending) {
  tell(form, sentence);
  const key = form.elements._idempotency_key?.value ?? newKey();
  // A file takes its time to be read: what is said of it stays until the server is known to be away.
  const answer = await sending({
    key, onWaiting: () => tell(form, say("waiting")), onLate: () => {}, onPromise: (outcome) => tell(form, sayKept(key, outcome)),
  });
  tell(form, "");
  return answer;
}

/** Draw the page anew, also the field that was just used; the focus returns to it. */
async function drawn() {
  const focused = document.activeElement?.id;
  document.activeElement?.blur();
  await redraw();
  if (focused) document.getElementById(focused)?.focus();
}

function sentenceOf({ body }) {
  return body.errors?.[0]?.sentence ?? body.detail ?? say("unsaid");
}
