// The demo's page: presses the drill's door and keeps a list of what it was told.
//
// It hears of an outage as any page does, from the crisis script's events on the document, and opens no channel of
// its own. The coffee is sent as every page of ours sends: under one key, again with the same key when the answer
// says that nothing was done, and it counts as booked only when an answer says so.

const WORDS = JSON.parse(document.body.dataset.words);
const LINES_MAX = 60;
const TRIES_MAX = 30;
const LATER_MS = 3000;
const log = document.getElementById("log");
let isDown = false;
let stage = null; // the last one that was told
let waiting = 0;

function say(code, values = {}, mood = "") {
  log.querySelector(".empty")?.remove();
  const now = new Date();
  const time = document.createElement("time");
  time.dateTime = now.toISOString();
  time.textContent = now.toTimeString().slice(0, 8) + "." + String(now.getMilliseconds()).padStart(3, "0");
  const text = document.createElement("span");
  text.textContent = WORDS[code].replace(/\{(\w+)\}/g, (_, name) => values[name]);
  if (mood) text.className = mood;
  const line = document.createElement("li");
  line.append(time, text);
  log.prepend(line);
  while (log.children.length > LINES_MAX) log.lastElementChild.remove();
}

async function press(fault) {
  say("log.pressed", { fault: WORDS[fault] });
  try {
    const answer = await fetch(`/__hc/drill/${fault}`, { method: "POST" });
    if (!answer.ok) say("log.refused", { why: (await answer.json()).detail }, "bad");
  } catch {
    say("log.refused", { why: WORDS.offline }, "bad");
  }
}

function pending(change) {
  waiting += change;
  document.dispatchEvent(new CustomEvent("hc:pending", { detail: { count: waiting } }));
}

// Resolves when it makes sense to ask again: the server is said to be back, or the time it named is over.
function worthAsking(seconds) {
  return new Promise((resolve) => {
    const done = () => {
      clearTimeout(timer);
      document.removeEventListener("hc:back", done);
      resolve();
    };
    const timer = setTimeout(done, seconds * 1000);
    document.addEventListener("hc:back", done);
  });
}

async function send(path, options) {
  for (let tries = 1; ; tries += 1) {
    let answer = null;
    try {
      answer = await fetch(path, options);
    } catch {
      if (tries === TRIES_MAX) throw new Error(WORDS.offline);
    }
    if (answer && (answer.status !== 503 || tries === TRIES_MAX)) return answer;
    say("log.again");
    await worthAsking(Number(answer?.headers.get("Retry-After")) || 2);
  }
}

// Random bytes, because crypto.randomUUID is there in secure contexts only.
function newKey() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function today() {
  const now = new Date();
  const two = (number) => String(number).padStart(2, "0");
  return `${now.getFullYear()}-${two(now.getMonth() + 1)}-${two(now.getDate())}`;
}

async function bookCoffee() {
  const began = performance.now();
  const key = newKey();
  const mark = `${WORDS.coffee} ${key.slice(0, 6)}`;
  const body = {
    date: today(), amount: "-3500", currency: "KRW", description: mark,
    category: WORDS.category, payment_method: WORDS.method, tags: [],
  };
  say("log.sent");
  pending(1);
  try {
    const answer = await send("/api/ledger/entries", {
      method: "POST",
      headers: { "Content-Type": "application/json", "Idempotency-Key": key },
      body: JSON.stringify(body),
    });
    const told = await answer.json();
    if (!answer.ok) throw new Error(told.detail);
    say("log.booked", { ms: Math.round(performance.now() - began) }, "ok");
    const found = await send(`/api/ledger/entries?q=${encodeURIComponent(mark)}`, {});
    if (found.ok) say("log.once", { n: (await found.json()).items.length }, "ok");
  } catch (error) {
    say("log.failed", { why: error.message }, "bad");
  } finally {
    pending(-1);
  }
}

for (const button of document.querySelectorAll("[data-fault]")) {
  button.addEventListener("click", () => {
    const fault = button.dataset.fault;
    if (!document.getElementById("later").checked) {
      press(fault);
      return;
    }
    say("log.soon", { fault: WORDS[fault] });
    setTimeout(press, LATER_MS, fault);
    document.getElementById("note").focus();
  });
}
document.getElementById("send").addEventListener("click", bookCoffee);
document.getElementById("language").addEventListener("click", (event) => {
  document.cookie = `lang=${event.target.lang}; Path=/; SameSite=Lax; Max-Age=31536000`;
  location.reload();
});

// By the state frames alone: of the first one after a time of peace, hc:down is told later than hc:state.
document.addEventListener("hc:state", ({ detail }) => {
  if (detail.text === null) return;
  if (!isDown) say(detail.planned ? "log.planned" : "log.down", {}, "bad");
  isDown = true;
  if (detail.stage && detail.stage !== stage) {
    stage = detail.stage;
    say("log.stage", { stage, name: WORDS[`stage.${stage}`] });
  }
});
document.addEventListener("hc:back", ({ detail }) => {
  isDown = false;
  stage = null;
  if (detail.outage_ms === null) say("log.again_there", {}, "ok");
  else say("log.back", { ms: Math.round(detail.outage_ms) }, "ok");
});
