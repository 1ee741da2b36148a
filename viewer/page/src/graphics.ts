/** Whether the browser draws with a graphics card. */

const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** Return whether WebGL runs on the CPU, as in a virtual machine; unknown counts as a graphics card. */
export function drawsInSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return false;
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name: unknown = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext(); // browsers limit the number of contexts
  return typeof name === "string" && SOFTWARE.test(name);
}
