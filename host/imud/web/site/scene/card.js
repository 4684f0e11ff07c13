// SPDX-License-Identifier: MIT
// @ts-check
// Whether this machine draws pictures by a graphics card or by its processor.

const PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** @type {boolean | null} */
let found = null;

/** Whether the browser has no graphics card to draw with. */
export function isDrawnByProcessor() {
  found ??= look();
  return found;
}

function look() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (gl === null) {
    return true;
  }
  // Firefox names it at once, Chromium only by the extension.
  const name = String(gl.getParameter(gl.RENDERER));
  const more = /webkit/i.test(name) ? gl.getExtension("WEBGL_debug_renderer_info") : null;
  const full = more ? String(gl.getParameter(more.UNMASKED_RENDERER_WEBGL)) : name;
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return PROCESSOR.test(full);
}
