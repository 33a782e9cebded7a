// The full form says while one types whether both sides are equal. It only adds up what is typed, with whole numbers; what
// counts is what the ledger says.

import { groupAmount, readAmount } from "./amounts.js";
import { say } from "./words.js";

const DIGITS = 6; // no currency has more

const form = document.querySelector("form[data-balance]");
if (form) {
  form.addEventListener("input", () => tellBalance());
  form.addEventListener("input", ({ target }) => {
    // One line has one side: whoever types into the other one means it to be there.
    if (!target.dataset.side || !target.value) return;
    const other = target.closest("fieldset").querySelector(`[data-side]:not([data-side="${target.dataset.side}"])`);
    other.value = "";
  });
  tellBalance();
}

function tellBalance() {
  const sums = new Map();
  for (const line of form.querySelectorAll(".tx-line")) {
    const currency = line.querySelector("select").selectedOptions[0]?.dataset.currency;
    for (const field of line.querySelectorAll("[data-side]")) {
      const amount = readAmount(field.value);
      if (!currency || amount === null || !field.value) continue;
      const minor = whole(amount) * (field.dataset.side === "debit" ? 1n : -1n);
      sums.set(currency, (sums.get(currency) ?? 0n) + minor);
    }
  }
  const off = [...sums].filter(([, sum]) => sum !== 0n).map(([currency, sum]) => `${shown(sum)} ${currency}`);
  const place = form.querySelector("[data-even]");
  const text = sums.size === 0 ? "" : off.length === 0 ? say("tx_even") : say("tx_uneven", { off: off.join(", ") });
  if (place.textContent !== text) place.textContent = text;
  place.classList.toggle("even", sums.size > 0 && off.length === 0);
}

function whole(amount) {
  const [units, fraction = ""] = amount.split(".");
  return BigInt(units + fraction.slice(0, DIGITS).padEnd(DIGITS, "0"));
}

function shown(sum) {
  const text = String(sum < 0n ? -sum : sum).padStart(DIGITS + 1, "0");
  const fraction = text.slice(-DIGITS).replace(/0+$/, "");
  return groupAmount(text.slice(0, -DIGITS)) + (fraction ? `.${fraction}` : "");
}
