// The words of the scripts, in the language of the page: one module per language, made by the server from the
// same catalogue as the page itself. A number is how many there are of something, grouped as one writes it.

import { groupAmount } from "./amounts.js";

const { default: words } = await import(`./words.${document.documentElement.lang}.js`);

/** Return a text with its values put in. */
export function say(name, values = {}) {
  return words[name].replace(/\{(\w+)\}/g, (_, value) => {
    const said = values[value];
    return typeof said === "number" ? groupAmount(String(said)) : String(said);
  });
}
