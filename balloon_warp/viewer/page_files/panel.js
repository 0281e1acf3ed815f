// The drawer of a phone, and the sheet of keys.
(() => {
  "use strict";
  const DRAWER = '[style*="max-height: 60%"]';  // as viser writes its panel where the window is narrow
  const TYPED = 'input:not([type="checkbox"]), textarea, select, [contenteditable="true"]';
  let drawer = null;

  // The view ends where the drawer begins. It is folded at first: one comes to see a balloon.
  const sized = new ResizeObserver(() => {
    document.documentElement.style.setProperty("--bw-drawer", `${drawer ? drawer.offsetHeight : 0}px`);
  });
  new MutationObserver(() => {
    const found = document.querySelector(DRAWER);
    if (found === drawer) return;
    if (drawer) sized.unobserve(drawer);
    drawer = found;
    if (!drawer) return;
    sized.observe(drawer);
    const handle = drawer.querySelector('[style*="cursor: pointer"]');
    if (handle) handle.click();
  }).observe(document, {childList: true, subtree: true});

  function toggleKeys() {
    const open = document.querySelector(".bw-sheet");
    if (open) return open.remove();
    const sheet = document.createElement("dialog");
    sheet.className = "bw-sheet";
    sheet.append(document.getElementById("bw-keys").content.cloneNode(true));
    sheet.addEventListener("click", () => sheet.remove());
    sheet.addEventListener("close", () => sheet.remove());
    document.body.append(sheet);
    sheet.showModal();
  }
  document.addEventListener("keydown", (event) => {
    if (event.key === "?" && !event.target.closest?.(TYPED)) toggleKeys();
  });
  document.addEventListener("click", (event) => {
    if (event.target.closest?.(".bw-keys-button")) toggleKeys();
  });
})();
