// Before the first paint: the theme that was chosen last.
(() => {
  const chosen = localStorage.getItem("seod-theme");
  if (chosen) document.documentElement.dataset.theme = chosen;
})();
