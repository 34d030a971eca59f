"use strict";
// A run without a plan yet: shows its messages.

(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const setTheme = () => (document.documentElement.dataset.theme = dark.matches ? "dark" : "light");
  dark.addEventListener("change", setTheme);
  setTheme();
  window.a465 = followRun(null, {
    news: ({ lines }) => showTold(lines),
    state: showState,
  });
})();
