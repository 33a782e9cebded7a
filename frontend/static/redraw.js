// The server draws, the page asks for the drawing again: after something changed, the same URL is fetched and the
// parts marked `data-live` take over what is different. Rows are known by their id and keep their place and their
// focus. A second set of templates in the browser was not chosen: two drawings of one ledger drift apart.

const PAUSE_MS = 150;
const PAUSE_AGAIN_MS = 1000; // while changes keep coming, as in an import

let timer = 0;
let drawing = false;
let again = false;

/** Redraw soon; any number of calls meanwhile are one. */
export function redrawSoon(ms = PAUSE_MS) {
  if (document.hidden || drawing) {
    again = true;
    return;
  }
  if (!timer) timer = setTimeout(redraw, ms);
}

/** Redraw now. Returns false where the server could not be asked; what is shown stays. */
export async function redraw() {
  clearTimeout(timer);
  timer = 0;
  drawing = true;
  again = false;
  try {
    const response = await fetch(location.href, { headers: { Accept: "text/html" }, cache: "no-store" });
    if (!response.ok) return false;
    const fresh = new DOMParser().parseFromString(await response.text(), "text/html");
    // What was drawn without this page's accounts has another shape: there is nothing to take over piece by piece.
    if (!document.querySelector("[data-live]") && fresh.querySelector("[data-live]")) location.reload();
    for (const part of fresh.querySelectorAll("[data-live]")) {
      const here = document.getElementById(part.id);
      if (here && !here.parentElement.closest("[data-live]")) take(here, part);
    }
    document.dispatchEvent(new CustomEvent("ledger:drawn"));
    return true;
  } catch {
    return false; // no server at the moment: hc:back asks again
  } finally {
    drawing = false;
    if (again) redrawSoon(PAUSE_AGAIN_MS);
  }
}

document.addEventListener("visibilitychange", () => {
  if (!document.hidden && again) redrawSoon();
});

function take(here, fresh) {
  if (here.isEqualNode(fresh) || isBusy(here)) return;
  dress(here, fresh);
  const known = new Map([...here.children].filter((child) => child.id).map((child) => [child.id, child]));
  if (!known.size || ![...fresh.children].some((child) => known.has(child.id))) {
    here.replaceChildren(...[...fresh.childNodes].map((node) => document.importNode(node, true)));
    return;
  }
  const kept = [...fresh.childNodes].map((node) => {
    const old = node.id ? known.get(node.id) : undefined;
    if (!old) {
      const made = document.importNode(node, true);
      if (made.id && made.classList) made.classList.add("fresh");
      return made;
    }
    if (old.tagName === node.tagName) take(old, node);
    return old;
  });
  // Only what is not where it belongs is moved: to move a node loses its focus.
  for (const child of [...here.childNodes]) if (!kept.includes(child)) child.remove();
  kept.forEach((node, at) => {
    if (here.childNodes[at] !== node) here.insertBefore(node, here.childNodes[at] ?? null);
  });
}

// The attributes too, but not what the reader did: an opened part stays open.
function dress(here, fresh) {
  for (const { name } of [...here.attributes]) if (name !== "open" && !fresh.hasAttribute(name)) here.removeAttribute(name);
  for (const { name, value } of [...fresh.attributes]) if (here.getAttribute(name) !== value) here.setAttribute(name, value);
}

// What somebody has opened or stands in is left as it is; it is drawn again when they have left.
function isBusy(part) {
  const inIt = document.activeElement?.closest("input, select, textarea");
  return part.querySelector("details[open] form") !== null || (inIt && part.contains(inIt) && part.matches("form, form *"));
}
