// Data in the page: base64 of zlib's deflate in a <script type="application/octet-stream">.
"use strict";

async function unpack(id) {
  const packed = Uint8Array.from(atob(document.getElementById(id).textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Single precision numbers whose first, second, third and fourth bytes were packed apart, which deflate likes.
function floatsOf(bytes) {
  const count = bytes.length / 4, joined = new Uint8Array(bytes.length);
  for (let k = 0; k < 4; k++) for (let i = 0; i < count; i++) joined[4 * i + k] = bytes[k * count + i];
  return new Float32Array(joined.buffer);
}

// Light or dark as the reader's system is, until the button says otherwise; #dark and #light say so from the start.
function themes(button, changed) {
  const root = document.documentElement, system = matchMedia("(prefers-color-scheme: dark)");
  const told = location.hash.match(/\b(dark|light)\b/);
  const show = (theme) => { root.dataset.theme = theme; changed(); };
  button.onclick = () => show(root.dataset.theme === "dark" ? "light" : "dark");
  system.addEventListener("change", () => show(system.matches ? "dark" : "light"));
  show(told ? told[1] : system.matches ? "dark" : "light");
}

function failed(error) {
  const note = document.getElementById("fault");
  note.textContent = `This page cannot be shown: ${error.message || error}. A browser of 2023 or later is needed.`;
  note.hidden = false;
}
