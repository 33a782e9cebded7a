// What is being typed, kept in this tab until it was sent.
//
// Fields of forms marked `data-hc-draft` are written to sessionStorage and read back, because only what was read
// back may be called stored. Restoring fills fields that hold nothing of their own, can be undone, and sends nothing.
// localStorage was not chosen: on a shared computer another person's half-written entry is nobody's business.

const PREFIX = "hc:draft:";
const SAVE_AFTER_MS = 300;
const DRAFTS_MAX = 20;
const DRAFT_CHARACTERS_MAX = 100000;
const NEVER = new Set(["password", "file", "hidden", "submit", "button", "reset", "image"]);
const SECRET = /one-time-code|\bcc-|password/;

function isCheck(field) {
  return field.type === "checkbox" || field.type === "radio";
}

const secret = new WeakSet();  // seen as a password once: a button may show what is in it

function isKept(field) {
  if (field.type === "password") secret.add(field);
  return !secret.has(field) && Boolean(field.name) && "value" in field && !NEVER.has(field.type) && !field.closest("[data-hc-nodraft]")
    && !SECRET.test(field.autocomplete ?? "");
}

function isChanged(field) {
  if (isCheck(field)) return field.checked !== field.defaultChecked;
  if (field.options) {
    const first = [...field.options].findIndex((option) => option.defaultSelected);
    return field.selectedIndex !== (field.multiple ? first : Math.max(first, 0));
  }
  return field.value !== field.defaultValue;
}

function isFree(field) {
  return !isChanged(field) || (!isCheck(field) && field.value === "");
}

function read(field) {
  if (isCheck(field)) return field.checked;
  return field.multiple && field.options ? [...field.selectedOptions].map((option) => option.value) : field.value;
}

function write(field, value) {
  if (isCheck(field)) field.checked = value;
  else if (Array.isArray(value)) for (const option of field.options) option.selected = value.includes(option.value);
  else field.value = value;
  field.dispatchEvent(new Event("input", { bubbles: true }));
  field.dispatchEvent(new Event("change", { bubbles: true }));
}

// A name and its place among the fields of that name find a field again in a page that was made anew.
function addressed(form) {
  const seen = {};
  return [...form.elements].filter(isKept).map((field) => {
    seen[field.name] = (seen[field.name] ?? -1) + 1;
    return [`${field.name}:${seen[field.name]}`, field];
  });
}

// Of whoever is signed in: the next person at this browser is somebody else.
function keyOf(form) {
  return `${PREFIX}${document.documentElement.dataset.user ?? ""}@${location.pathname}#${form.id}`;
}

function isDraftForm(form) {
  return form instanceof HTMLFormElement && form.hasAttribute("data-hc-draft") && form.id !== "";
}

function load(key) {
  try { return JSON.parse(sessionStorage.getItem(key)); } catch { return null; }  // no storage, or not ours
}

function forget(form) {
  try { sessionStorage.removeItem(keyOf(form)); } catch { /* no storage: nothing was kept */ }
}

// Written and read back: true only if this browser really has it.
function store(key, draft) {
  const written = JSON.stringify(draft);
  if (written.length > DRAFT_CHARACTERS_MAX) return false;
  try {
    sessionStorage.setItem(key, written);
    const others = Object.keys(sessionStorage).filter((name) => name.startsWith(PREFIX) && name !== key);
    others.sort((one, two) => (load(one)?.at ?? 0) - (load(two)?.at ?? 0));
    others.slice(0, Math.max(0, others.length + 1 - DRAFTS_MAX)).forEach((name) => sessionStorage.removeItem(name));
    return sessionStorage.getItem(key) === written;
  } catch { return false; }  // full or forbidden
}

/** Keep drafts of this page. `changed` is called after each save. */
export function keepDrafts(changed) {
  const touched = new Set();  // fields typed into since the page was opened
  const stored = new WeakMap();  // form -> whether its last save was read back
  const tried = new WeakSet();  // forms that were submitted since the last success
  let timer = 0;

  function save(form) {
    const fields = Object.fromEntries(addressed(form).filter(([, field]) => isChanged(field))
      .map(([address, field]) => [address, read(field)]));
    if (Object.keys(fields).length === 0) forget(form);
    else stored.set(form, store(keyOf(form), { at: Date.now(), tried: tried.has(form), fields }));
  }

  function saveAll() {
    clearTimeout(timer);
    new Set([...touched].filter((field) => isDraftForm(field.form)).map((field) => field.form)).forEach(save);
    changed();
  }

  function gone(form) {
    for (const field of touched) if (field.form === form) touched.delete(field);
    tried.delete(form);
    if (isDraftForm(form)) forget(form);
  }

  /** What may be said of the text on this page: "stored", "page", or null if nothing was typed. */
  function standing() {
    const typed = typedFields();
    if (typed.length === 0) return null;
    return typed.every((field) => isDraftForm(field.form) && isKept(field) && stored.get(field.form)) ? "stored" : "page";
  }

  function typedFields() {
    for (const field of touched) if (!field.isConnected) touched.delete(field);
    return [...touched].filter((field) => isChanged(field));
  }

  /** The typed text, a line for each field; nothing secret. */
  function asText() {
    return typedFields().filter((field) => isKept(field) && !isCheck(field))
      .map((field) => `${field.labels?.[0]?.textContent.trim() || field.name}: ${field.value}`).join("\n");
  }

  /** Fill what a reload has emptied. Gives {tried, undo}, or null if there was nothing to fill. */
  function restore() {
    const filled = [];
    let wasTried = false;
    for (const form of [...document.forms].filter(isDraftForm)) {
      const draft = load(keyOf(form));
      if (!draft?.fields) continue;
      if (draft.tried) tried.add(form);
      for (const [address, field] of addressed(form)) {
        const value = draft.fields[address];
        if (value === undefined || !isFree(field) || read(field) === value) continue;
        filled.push([field, read(field)]);
        wasTried ||= draft.tried;
        write(field, value);
      }
    }
    saveAll();
    return filled.length === 0 ? null : {
      tried: wasTried,
      undo() {
        filled.forEach(([field, before]) => write(field, before));
        filled.forEach(([field]) => gone(field.form));
      },
    };
  }

  document.addEventListener("input", (event) => {
    const field = event.composedPath()[0];
    if (!field.form && !("defaultValue" in field)) return;
    isKept(field);
    touched.add(field);
    clearTimeout(timer);
    timer = setTimeout(saveAll, SAVE_AFTER_MS);
  }, true);
  document.addEventListener("focusin", (event) => isKept(event.composedPath()[0]), true);
  document.addEventListener("submit", (event) => {
    tried.add(event.target);
    saveAll();
  }, true);
  document.addEventListener("hc:sent", (event) => gone(event.target));
  document.addEventListener("reset", (event) => gone(event.target));
  addEventListener("pagehide", saveAll);
  return { saveAll, standing, asText, restore };
}
