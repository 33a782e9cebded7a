// Ticks on a list of letters: one for all of them, and a word that the list stands still while something is ticked.

function follow(form) {
  const every = form.querySelector("[data-every]");
  const ticks = () => [...form.querySelectorAll("input[name=id]")];
  every.hidden = false;
  const tell = () => {
    const ticked = ticks().filter((one) => one.checked).length;
    every.checked = ticked > 0 && ticked === ticks().length;
    every.indeterminate = ticked > 0 && !every.checked;
    form.querySelector("[data-paused]").hidden = form.querySelector("input:checked") === null;
  };
  every.addEventListener("change", () => {
    for (const one of ticks()) one.checked = every.checked;
    tell();
  });
  form.addEventListener("change", tell);
  tell();
}

for (const form of document.querySelectorAll("[data-select]")) follow(form);
document.addEventListener("admin:drawn", ({ target }) => {
  if (target.matches("[data-select]")) follow(target);
});
