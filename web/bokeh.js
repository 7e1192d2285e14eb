// The renderer: pictures of the canvas in and out, one ONNX file between. Needs the global `ort` of onnxruntime-web.

const toLinear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
const toSrgb = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
const LINEAR = Float32Array.from({ length: 256 }, (_, code) => toLinear(code / 255));

/** Scene-linear (H, W, 3) of an ImageData. */
function linearTensor({ data, width, height }) {
  const values = new Float32Array(width * height * 3);
  for (let i = 0, j = 0; i < data.length; i += 4) {
    for (let c = 0; c < 3; c++) values[j++] = LINEAR[data[i + c]];
  }
  return new ort.Tensor("float32", values, [height, width, 3]);
}

/** Disparity (H, W) in [0, 1] of a grey ImageData. */
function disparityTensor({ data, width, height }) {
  const values = Float32Array.from({ length: width * height }, (_, i) => data[4 * i] / 255);
  return new ort.Tensor("float32", values, [height, width]);
}

/** ImageData of a scene-linear tensor (H, W, 3); light beyond white is clipped. */
function toImageData({ data, dims: [height, width] }) {
  const picture = new ImageData(width, height);
  for (let i = 0, j = 0; j < data.length; i += 4) {
    for (let c = 0; c < 3; c++) picture.data[i + c] = Math.round(255 * toSrgb(Math.min(data[j++], 1)));
    picture.data[i + 3] = 255;
  }
  return picture;
}

const number = (value) => new ort.Tensor("float32", Float32Array.of(value), []);

/**
 * Render a photo (ImageData) with its disparity (grey ImageData of the same size, near is bright).
 * K is the blur radius in pixels of a point one unit of disparity away from `focus`.
 */
export async function renderBokeh(session, photo, disparity, { K, focus, gamma = 1 }) {
  const { bokeh } = await session.run({
    image: linearTensor(photo),
    disparity: disparityTensor(disparity),
    K: number(K),
    focus: number(focus),
    gamma: number(gamma),
  });
  return toImageData(bokeh);
}

/** Return the disparity of a photo, both as ImageData, with its soft edges at edges of the photo. */
export async function repairDisparity(session, photo, disparity) {
  const { repaired } = await session.run({ image: linearTensor(photo), disparity: disparityTensor(disparity) });
  const result = new ImageData(disparity.width, disparity.height);
  for (let i = 0; i < repaired.data.length; i++) {
    result.data.fill(Math.round(255 * repaired.data[i]), 4 * i, 4 * i + 3);
    result.data[4 * i + 3] = 255;
  }
  return result;
}
