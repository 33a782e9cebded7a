// What every page starts. Each part works alone; a page without any script is a page that still works.

import { watchAmounts } from "./amounts.js";
import { watchForms } from "./forms.js";
import { watchKeys } from "./keys.js";
import { watchKnown } from "./known.js";
import { listen } from "./live.js";
import { watchReceipts } from "./receipts.js";
import { watchToast } from "./toast.js";

watchForms();
watchAmounts(document);
ownDay();
listen();
watchReceipts();
watchToast();
watchKnown();
watchKeys(); // may begin an entry right away

// The server's day may not be the reader's: a fresh entry is of the day it is where it is typed.
function ownDay() {
  const now = new Date();
  const today = [now.getFullYear(), now.getMonth() + 1, now.getDate()].map((part) => String(part).padStart(2, "0")).join("-");
  for (const field of document.querySelectorAll("input[data-today]")) {
    if (field.value === field.dataset.today && field.defaultValue === field.dataset.today) field.value = field.defaultValue = today;
  }
}
