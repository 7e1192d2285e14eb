// Zoom and pan of the picture: Ctrl and wheel zoom at the pointer, two fingers zoom and move, Space and a drag move,
// 0 fits.

const MAX_ZOOM = 8, STEP = 1.25;

/**
 * Connect zoom and pan; returns {zoom(), fit(), panning()}. `changed` is called after each change of the zoom,
 * `discard` when a second finger ends what the first one has begun.
 */
export function makeView(stage, sheet, changed, discard) {
  const fingers = new Map();
  let zoom = 1, x = 0, y = 0, space = false, from = null;

  function apply() {
    const width = sheet.offsetWidth, height = sheet.offsetHeight;
    x = zoom === 1 ? 0 : Math.min(Math.max(x, -width * zoom * 0.9), width * 0.9);
    y = zoom === 1 ? 0 : Math.min(Math.max(y, -height * zoom * 0.9), height * 0.9);
    sheet.style.transform = zoom === 1 ? "" : `translate(${x}px, ${y}px) scale(${zoom})`;
    stage.dataset.zoom = zoom.toFixed(2);
  }

  function zoomTo(value, clientX, clientY) {
    const next = Math.min(Math.max(value, 1), MAX_ZOOM), box = sheet.getBoundingClientRect();
    x -= (clientX - box.left) * (next / zoom - 1);
    y -= (clientY - box.top) * (next / zoom - 1);
    zoom = next < 1.01 ? 1 : next;
    apply();
    changed();
  }

  stage.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !space) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    zoomTo(zoom * STEP ** -Math.sign(event.deltaY), event.clientX, event.clientY);
  }, { passive: false });
  /** Middle between two fingers, and their distance. */
  function grip() {
    const [[left, top], [right, bottom]] = fingers.values();
    return { x: (left + right) / 2, y: (top + bottom) / 2, span: Math.max(Math.hypot(right - left, bottom - top), 1) };
  }
  stage.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) discard();
  }, true);
  stage.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = fingers.size === 2 && grip();
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (!before) return;
    event.stopPropagation();
    const { x: middle, y: height, span } = grip();
    x += middle - before.x;
    y += height - before.y;
    apply();
    zoomTo((zoom * span) / before.span, middle, height);
  }, true);
  for (const end of ["pointerup", "pointercancel"]) {
    addEventListener(end, (event) => {
      if (fingers.size === 2 && fingers.has(event.pointerId)) discard();
      fingers.delete(event.pointerId);
    }, true);
  }

  stage.addEventListener("pointerdown", (event) => {
    if (!(space && event.button === 0) && event.button !== 1) return;
    event.preventDefault();
    event.stopPropagation();
    stage.setPointerCapture(event.pointerId);
    from = [event.clientX - x, event.clientY - y];
  }, true);
  stage.addEventListener("pointermove", (event) => {
    if (!from) return;
    [x, y] = [event.clientX - from[0], event.clientY - from[1]];
    apply();
  }, true);
  for (const end of ["pointerup", "pointercancel"]) stage.addEventListener(end, () => (from = null), true);
  const isField = (target) => /^(INPUT|SELECT|TEXTAREA|BUTTON|SUMMARY|A)$/.test(target.tagName);
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || isField(event.target)) return;
    event.preventDefault();
    space = true;
    stage.classList.add("pan");
  });
  const release = (event) => {
    if (event.type === "keyup" && event.key !== " ") return;
    space = false;
    stage.classList.remove("pan");
  };
  addEventListener("keyup", release);
  addEventListener("blur", release);
  const fit = () => {
    [zoom, x, y] = [1, 0, 0];
    apply();
    changed();
  };
  return { zoom: () => zoom, fit, panning: () => space || from !== null };
}
