// What every page begins with: its data, and where faults are told.
const data = JSON.parse(document.getElementById("data").textContent);
const at = (id) => document.getElementById(id);
const bytesOfText = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const pressing = (e) => e.target.tagName === "BUTTON" && (e.key === "Enter" || e.key === " "); // it presses a button
window.addEventListener("error", (e) => {
  document.body.dataset.error = e.message;
});
window.addEventListener("unhandledrejection", (e) => {
  document.body.dataset.error = String(e.reason);
});
