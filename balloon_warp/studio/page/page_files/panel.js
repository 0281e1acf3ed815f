// The drawer of a phone, with the most used of its buttons above it while it is folded, and the sheet of keys.
(() => {
  "use strict";
  const DRAWER = '[style*="max-height: 60%"]';  // as viser writes its panel where the window is narrow
  const TYPED = 'input:not([type="checkbox"]), textarea, select, [contenteditable="true"]';
  let drawer = null;

  // The view ends where the drawer begins. It is folded at first: one comes to see a balloon.
  const sized = new ResizeObserver(() => {
    document.documentElement.style.setProperty("--bw-drawer", `${drawer ? drawer.offsetHeight : 0}px`);
    thumb.classList.toggle("bw-open", drawer !== null && drawer.offsetHeight > 100);
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

  // What happens to such a button happens to the panel's of that name, of which there is one of two.
  const thumb = document.createElement("div");
  thumb.id = "bw-thumb";
  for (const [sign, ...names] of [["\u2212", "Deflate"], ["", "Pause", "Run"], ["+", "Inflate"]]) {
    const button = document.createElement("button");
    const meant = () => [...document.querySelectorAll(`${DRAWER} button`)].find((each) => names.includes(each.textContent.trim()));
    const pass = (type, {pointerId}) => meant()?.dispatchEvent(new PointerEvent(type, {bubbles: true, button: 0, pointerId}));
    button.textContent = sign;
    button.setAttribute("aria-label", names.join(" or "));
    button.addEventListener("pointerdown", (event) => pass("pointerdown", event));
    for (const type of ["pointerup", "pointercancel", "pointerleave"]) button.addEventListener(type, (event) => pass("pointerup", event));
    button.addEventListener("click", () => meant()?.click());
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    thumb.append(button);
  }
  document.addEventListener("DOMContentLoaded", () => document.body.append(thumb));

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
