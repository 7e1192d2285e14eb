// Two-finger gesture on the picture that turns the focus ring: apart is nearer, together is farther.

const STEP = 12; // change of the fingers' distance for one step of the ring, screen pixels

/** Call `ring(steps, event)` while two fingers move apart or together on an element. */
export function ringByTouch(element, ring) {
  const fingers = new Map();
  let span = 0;
  const keep = (event) => fingers.set(event.pointerId, [event.clientX, event.clientY]);
  const apart = () => {
    const [[x, y], [otherX, otherY]] = fingers.values();
    return Math.hypot(x - otherX, y - otherY);
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    keep(event);
    if (fingers.size === 2) span = apart();
  });
  element.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    keep(event);
    const steps = fingers.size === 2 ? Math.trunc((apart() - span) / STEP) : 0;
    if (!steps) return;
    span += STEP * steps;
    ring(steps, event);
  });
  for (const end of ["pointerup", "pointercancel"]) addEventListener(end, (event) => fingers.delete(event.pointerId));
}
