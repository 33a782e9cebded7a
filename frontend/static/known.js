// What was written before is offered again: the words as suggestions of the browser's own, and with known words their
// category, account and kind. Only what nobody has touched is filled in, and amounts never, because they differ each time.

const ASKED = "/api/ledger/entries?limit=200";
const OFFERED_MAX = 80;
const SAME = ["category", "account", "kind"];

/** Offer it in the form that writes entries. */
export function watchKnown(form = document.querySelector("form#entry")) {
  if (!form) return;
  const words = form.elements.description;
  const list = document.createElement("datalist");
  const known = new Map();
  const touched = new Set();
  const ours = new Map(); // name -> what stood there before it was filled in
  list.id = "known-words";
  words.after(list);
  words.setAttribute("list", list.id);
  words.addEventListener("focus", () => void ask(list, known).then(match));
  form.addEventListener("input", ({ target, isTrusted }) => {
    if (target === words) match();
    else if (isTrusted) touched.add(target.name);
  });
  form.addEventListener("hc:sent", () => {
    touched.clear();
    ours.clear();
  });

  function match() {
    const before = known.get(words.value.trim());
    for (const name of SAME.filter((one) => !touched.has(one))) {
      if (before && !ours.has(name)) ours.set(name, form.elements[name].value);
      if (before) fill(form, name, before[name]);
      else if (ours.has(name)) fill(form, name, ours.get(name));
    }
    if (!before) ours.clear();
  }
}

// Asked each time the form is begun anew: it is a small question, and other people write too.
async function ask(list, known) {
  try {
    const response = await fetch(ASKED, { headers: { Accept: "application/json" }, cache: "no-store" });
    if (!response.ok) return;
    const { items } = await response.json();
    known.clear();
    for (const { description, category, account, amount } of items) {
      if (!description || known.has(description)) continue;
      known.set(description, { category: category ?? "", account, kind: amount.startsWith("-") ? "out" : "in" });
    }
    list.replaceChildren(...[...known.keys()].slice(0, OFFERED_MAX).map((text) => new Option("", text)));
  } catch {
    // No server at the moment: nothing is offered.
  }
}

function fill(form, name, value) {
  const field = form.elements[name];
  if (field instanceof HTMLSelectElement && ![...field.options].some((one) => one.value === value)) return;
  field.value = value;
}
