// What every page begins with: its data, drawing at the next frame, and where faults are shown.
const data = JSON.parse(document.getElementById("data").textContent);
const at = (id) => document.getElementById(id);
const bytesOfText = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const pressing = (e) => e.target.tagName === "BUTTON" && (e.key === "Enter" || e.key === " "); // it presses a button
// A function that does so once at the next frame, however often it is called before.
const atNextFrame = (draw) => {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      draw();
    });
  };
};
window.addEventListener("error", (e) => {
  document.body.dataset.error = e.message;
});
window.addEventListener("unhandledrejection", (e) => {
  document.body.dataset.error = String(e.reason);
});
