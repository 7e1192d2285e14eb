// Ends of the range in focus, in the unit of the map: relative disparity, or 1/mm of metric depth.

import { valueOf } from "./panels.js";

const KINDS = ["value", "distance", "at", "range", "plane"];

/** Return [far, near]: the smallest and the largest disparity in focus; null if the focus is unknown. */
export function focusEnds(state, facts) {
  const range = valueOf(state.settings, "focus.range");
  if (!Array.isArray(range)) return facts.focus_disparity == null ? null : [facts.focus_disparity, facts.focus_disparity];
  const ends = state.kind === "metric" ? range.map((metres) => 1 / (1000 * metres)) : range;
  return [Math.min(...ends), Math.max(...ends)];
}

/** Return changes that focus from one disparity to another; equal ones focus on a plane. */
export function focusChange(state, far, near) {
  const metres = (disparity) => Number((1 / (1000 * Math.max(disparity, 1e-6))).toPrecision(4));
  const relative = (disparity) => Number(Math.min(Math.max(disparity, 0), 1).toFixed(4));
  const single = far === near;
  if (state.kind === "metric") return { focus: single ? { distance: metres(near) } : { range: [metres(near), metres(far)] } };
  return { focus: single ? { value: relative(near) } : { range: [relative(far), relative(near)] } };
}

/** Return changes that restore the focus with which the picture opened. */
export function initialFocus(state) {
  return { focus: { ...Object.fromEntries(KINDS.map((name) => [name, null])), ...state.initial?.focus } };
}
