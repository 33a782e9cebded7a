// Amounts in the field where they are typed: grouped by three as one writes, and never turned into a number, because
// a float changes amounts. Its twin on the server is frontend/amounts.py; one list of cases holds both.

const DECORATION = /[\s_'’원엔$€£¥₩₹₱฿₫]/g;
const GROUPED = /^[0-9]{1,3}(,[0-9]{3})+(\.[0-9]+)?$/;
const PLAIN = /^([0-9]+(\.[0-9]*)?|\.[0-9]+)$/;
const TYPED_CHARACTERS_MAX = 60;

/** Return what somebody typed as an unsigned decimal string, null if it is no amount. */
export function readAmount(typed) {
  if ([...typed].length > TYPED_CHARACTERS_MAX) return null;
  let text = typed.normalize("NFKC").replace(DECORATION, "");
  if (GROUPED.test(text)) text = text.replaceAll(",", "");
  if (!PLAIN.test(text)) return null;
  const [whole, fraction = ""] = text.split(".");
  const kept = whole.replace(/^0+/, "") || "0";
  return fraction ? `${kept}.${fraction}` : kept;
}

/** Return digits with a comma before each three; what is no plain number stays as it is. */
export function groupAmount(typed) {
  const text = typed.replaceAll(",", "");
  if (!/^[0-9]+(\.[0-9]*)?$/.test(text)) return typed;
  const [whole, ...fraction] = text.split(".");
  return [whole.replace(/\B(?=([0-9]{3})+$)/g, ","), ...fraction].join(".");
}

/** Group the field while it is typed into; the caret stays behind the digit it was behind. */
export function watchAmounts(root) {
  root.addEventListener("input", (event) => {
    const field = event.target;
    if (!(field instanceof HTMLInputElement) || !("amount" in field.dataset) || event.isComposing) return;
    const grouped = groupAmount(field.value);
    if (grouped === field.value) return;
    const before = field.value.slice(0, field.selectionStart ?? 0).replaceAll(",", "").length;
    field.value = grouped;
    let at = 0;
    for (let seen = 0; seen < before && at < grouped.length; at += 1) if (grouped[at] !== ",") seen += 1;
    field.setSelectionRange(at, at);
  });
}
