// A quick picture for the hand that drags: a gather in WebGL, beside the page. The renderer's picture replaces it.
//
// Each pixel looks along a spiral and takes what is blurred over it; what lies farther away spreads no more than
// the pixel itself is blurred (Jimenez, "Next generation post processing in Call of Duty", SIGGRAPH 2014).

const TAPS = 40;

// Places of a spiral in the unit disc, and how far out each is.
const SPIRAL = Float32Array.from({ length: 3 * TAPS }, (_, at) => {
  const tap = Math.floor(at / 3), away = Math.sqrt((tap + 0.5) / TAPS), turn = 2.39996323 * tap;
  return [away * Math.cos(turn), away * Math.sin(turn), away][at % 3];
});

// Milliseconds of a frame beyond which the next one is smaller, and below which it is larger; sides over the
// largest one.
const SLOW = 60;
const QUICK = 20;
const SIDES = [1, 0.71, 0.5, 0.35, 0.25];

const CORNERS = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

const GATHER = `#version 300 es
precision highp float;
uniform sampler2D photo, disparity;
uniform float blur, focus, reach, detail;
uniform vec2 size;
uniform vec3 spiral[${TAPS}];
out vec4 shown;
const float PI = 3.14159265;

float radius(vec2 place) {
  return blur * (textureLod(disparity, place, 0.0).r - focus);
}

void main() {
  vec2 place = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y) / size;
  float own = radius(place);
  float weight = 1.0 / max(PI * own * own, 1.0);
  vec3 sum = weight * textureLod(photo, place, 0.0).rgb;
  float share = reach * reach / float(${TAPS});
  for (int i = 0; i < ${TAPS}; i++) {
    float away = reach * spiral[i].z;
    vec2 other = place + reach * spiral[i].xy / size;
    float there = radius(other);
    float wide = there < own - 1.0 ? min(abs(there), abs(own)) : abs(there);
    float part = share * clamp(wide - away + 0.5, 0.0, 1.0) / max(wide * wide, 0.25);
    sum += part * textureLod(photo, other, detail).rgb;
    weight += part;
  }
  vec3 light = clamp(sum / weight, 0.0, 1.0);
  vec3 low = 12.92 * light, high = 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055;
  shown = vec4(mix(high, low, lessThanEqual(light, vec3(0.0031308))), 1.0);
}`;

let canvas;
let gl;
let place;
let whole = { width: 1, height: 1, scale: 1 };
let step = 0;
let requested;

function compiled(kind, text) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, text);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
  return shader;
}

function begin() {
  gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
  if (!gl) throw new Error("this browser has no WebGL 2");
  const program = gl.createProgram();
  gl.attachShader(program, compiled(gl.VERTEX_SHADER, CORNERS));
  gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, GATHER));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  place = (name) => gl.getUniformLocation(program, name);
}

function texture(unit, bitmap, format) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, format, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
  gl.generateMipmap(gl.TEXTURE_2D);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
}

async function open({ photo, disparity, width, height, full }) {
  if (!gl) begin();
  const how = { resizeWidth: width, resizeHeight: height, resizeQuality: "high", colorSpaceConversion: "none" };
  const bitmaps = await Promise.all([photo, disparity].map((blob) => createImageBitmap(blob, how)));
  texture(0, bitmaps[0], gl.SRGB8_ALPHA8);
  texture(1, bitmaps[1], gl.RGBA8);
  gl.uniform3fv(place("spiral"), SPIRAL);
  gl.uniform1i(place("photo"), 0);
  gl.uniform1i(place("disparity"), 1);
  whole = { width, height, scale: width / full };
  postMessage({ ready: true });
}

/** Give the canvas its size, which clears it: before a frame, never after. */
function fit() {
  const [width, height] = [whole.width, whole.height].map((side) => Math.round(side * SIDES[step]));
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  gl.viewport(0, 0, width, height);
  gl.uniform2f(place("size"), width, height);
}

function draw({ K, focus }) {
  fit();
  const blur = K * whole.scale * SIDES[step];
  const reach = Math.max(1, Math.abs(blur) * Math.max(Math.abs(focus), Math.abs(1 - focus)));
  gl.uniform1f(place("blur"), blur);
  gl.uniform1f(place("focus"), focus);
  gl.uniform1f(place("reach"), reach);
  gl.uniform1f(place("detail"), Math.max(0, Math.log2((1.5 * reach) / Math.sqrt(TAPS) / SIDES[step])));
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
}

/** Draw the last numbers that were asked for, once a frame. */
function next() {
  const numbers = requested;
  requested = undefined;
  if (!numbers) return;
  try {
    const begun = performance.now();
    draw(numbers);
    const took = performance.now() - begun;
    postMessage({ drawn: numbers, took, width: canvas.width, height: canvas.height });
    const better = took > SLOW ? step + 1 : took < QUICK ? step - 1 : step;
    if (SIDES[better]) step = better;
  } catch (error) {
    postMessage({ error: error.message });
  }
  requestAnimationFrame(next);
}

onmessage = async ({ data }) => {
  try {
    if (data.canvas) canvas = data.canvas;
    if (data.open) await open(data.open);
    if (data.numbers && gl) {
      const idle = !requested;
      requested = data.numbers;
      if (idle) requestAnimationFrame(next);
    }
  } catch (error) {
    postMessage({ error: error.message });
  }
};
