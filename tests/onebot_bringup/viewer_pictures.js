// Pictures that take the longer the more pixels they have, as much longer with each until the canvas
// gets fewer. Of each is found whether the one before was drawn when it began.
const done = arguments[0], canvas = document.body.appendChild(document.createElement("canvas"));
canvas.style = "width: 600px; height: 400px";
new ResizeObserver(([entry]) => {
  canvas.width = entry.contentRect.width * devicePixelRatio;
  canvas.height = entry.contentRect.height * devicePixelRatio;
}).observe(canvas);
const gl = canvas.getContext("webgl2"), program = gl.createProgram();
function add(kind, text) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, `#version 300 es
precision highp float;
${text}`);
  gl.compileShader(shader);
  gl.attachShader(program, shader);
}
add(gl.VERTEX_SHADER, `void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`);
add(gl.FRAGMENT_SHADER, `uniform int steps; out vec4 color;
void main() {
  float x = gl_FragCoord.x;
  for (int i = 0; i < steps; i++) x = sin(x) + gl_FragCoord.y;
  color = vec4(x);
}`);
gl.linkProgram(program);
gl.useProgram(program);
let steps = 100, pictures = 0, early = 0, before = null;
const start = 600 * devicePixelRatio;
function draw() {
  if (before && gl.getSyncParameter(before, gl.SYNC_STATUS) !== gl.SIGNALED) early++;
  if (pictures && canvas.width < start || early) {
    return done({pictures, early, width: canvas.width / start, ratio: devicePixelRatio});
  }
  requestAnimationFrame(draw);
  if (canvas.width < start) return; // its size was not observed yet
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.uniform1i(gl.getUniformLocation(program, "steps"), steps = Math.min(1.2 * steps, 1e6));
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  before = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  pictures++;
}
requestAnimationFrame(draw);
