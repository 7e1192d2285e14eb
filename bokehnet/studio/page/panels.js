// Controls generated from the server's descriptions of the settings.

const byPath = new Map();

/** Return the value of a setting, or a fallback. */
export function valueOf(settings, path, fallback = null) {
  const [group, name] = path.split(".");
  return settings?.[group]?.[name] ?? fallback;
}

/** Return changes that set one field; null resets it to its default. */
export function changeOf(path, value) {
  const [group, name] = path.split(".");
  return { [group]: { [name]: value } };
}

function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name in element && name !== "list") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** Fill an element with one control per setting, by groups; `initialOf` returns the value to reset to. */
export function makePanels(place, panels, change, initialOf) {
  place.replaceChildren(make("h2", { textContent: "All settings" }));
  byPath.clear();
  for (const panel of panels) {
    const details = make("details", {}, make("summary", { textContent: panel.title }));
    for (const field of panel.fields) details.append(makeField(field, change, initialOf));
    place.append(details);
  }
}

function makeField(field, change, initialOf) {
  const id = `field-${field.path.replace(".", "-")}`;
  const help = make("div", { className: "help", id: `${id}-help`, textContent: field.help });
  const fault = make("div", { className: "fault", role: "alert" });
  const unit = field.unit ? make("span", { className: "unit", textContent: ` ${field.unit}` }) : "";
  const label = make("label", { htmlFor: id, title: `Double-click resets. On the command line: ${field.flag}` }, field.label, unit);
  label.addEventListener("dblclick", (event) => {
    event.preventDefault();
    change(changeOf(field.path, initialOf(field.path)), event);
  });
  const described = { id, "aria-describedby": help.id };
  const send = (value, event) => {
    fault.textContent = "";
    change(changeOf(field.path, value), event);
  };
  let input, slider = null;
  if (field.kind === "switch") {
    input = make("input", { type: "checkbox", ...described });
    input.addEventListener("change", (event) => send(input.checked, event));
  } else if (field.kind === "choice") {
    input = make("select", described);
    if (field.default === null) input.append(make("option", { value: "", textContent: "default" }));
    for (const word of field.choices) input.append(make("option", { value: word, textContent: word }));
    input.addEventListener("change", (event) => send(input.value || null, event));
  } else if (field.kind === "number" || field.kind === "whole") {
    const step = field.kind === "whole" ? 1 : "any";
    input = make("input", { type: "number", step, ...described, placeholder: field.default ?? "–" });
    input.addEventListener("change", (event) => send(input.value === "" ? null : Number(input.value), event));
    if (field.low !== null && field.high !== null) {
      const fine = field.kind === "whole" ? 1 : (field.high - field.low) / 200;
      slider = make("input", { type: "range", min: field.low, max: field.high, step: fine, "aria-label": field.label });
      slider.addEventListener("input", (event) => {
        input.value = slider.value;
        send(Number(slider.value), event);
      });
    }
  } else {
    input = make("input", { type: "text", ...described, placeholder: field.expected });
    input.addEventListener("change", (event) => send(parsed(field.kind, input.value), event));
  }
  const root = make("div", { className: "field" }, make("div", { className: "line" }, label, input), slider || "", help, fault);
  byPath.set(field.path, { field, input, slider, fault, root });
  return root;
}

function parsed(kind, text) {
  const words = text.trim();
  if (words === "") return null;
  if (kind === "text") return words;
  const groups = words.split(/\s+/).map((part) => part.split(",").map(Number));
  return groups.length === 1 ? groups[0] : groups;
}

/** Show the current settings. */
export function showSettings(settings) {
  for (const [path, { field, input, slider, root }] of byPath) {
    const value = valueOf(settings, path, field.default);
    root.classList.toggle("set", valueOf(settings, path) !== null);
    if (field.kind === "switch") input.checked = Boolean(value);
    else if (document.activeElement !== input) {
      const text = Array.isArray(value) ? (Array.isArray(value[0]) ? value.map(String).join(" ") : String(value)) : value;
      input.value = text ?? "";
    }
    if (slider && document.activeElement !== slider) slider.value = value ?? field.low;
  }
}

/** Show an error message at the control that caused it; return false if there is no such control. */
export function showFault(path, message) {
  const control = byPath.get(path);
  if (!control) return false;
  control.fault.textContent = message;
  control.root.closest("details").open = true;
  return true;
}

export function clearFaults() {
  for (const { fault } of byPath.values()) fault.textContent = "";
}
