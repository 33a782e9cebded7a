// The script of a receipt's page: it looks whether something has become of the wish, and opens the page again.
//
// There is a drawing for each outcome, so nothing is drawn here. Once the page has said what became of it, no other
// page of this browser has to.

const LOOK_EVERY_MS = 1000;
const LOOK_TIMEOUT_MS = 3000;

const shown = document.body.dataset.outcome;

async function look() {
  try {
    const response = await fetch(location.pathname, {
      headers: { Accept: "application/json" }, cache: "no-store", signal: AbortSignal.timeout(LOOK_TIMEOUT_MS),
    });
    if (response.ok && (await response.json()).outcome !== shown) {
      location.reload();
      return;
    }
  } catch { /* the gateway is away for a moment: the next look will tell */ }
  setTimeout(look, LOOK_EVERY_MS);
}

if (["waiting", "ask", "set_aside"].includes(shown)) void look();
else {
  document.querySelector("h1").focus();
  fetch(`${location.pathname}/seen`, { method: "POST" }).catch(() => {});  // if it is lost, another page says it once more
}
