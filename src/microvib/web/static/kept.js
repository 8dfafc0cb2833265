// What a tab keeps over a reload.

const PREFIX = "microvib.";

/** Keep a value under a key; false where the browser has no room for it. */
export function keep(key, value) {
  try {
    sessionStorage.setItem(PREFIX + key, JSON.stringify(value));
    return true;
  } catch {
    return false;
  }
}

/** What was kept under a key. */
export function kept(key, otherwise = null) {
  try {
    return JSON.parse(sessionStorage.getItem(PREFIX + key)) ?? otherwise;
  } catch {
    return otherwise;
  }
}

/** Keep what stands in fields, {name: input}, and bring back what stood there. */
export function keepFields(key, inputs) {
  const part = (input) => (input.type === "checkbox" ? "checked" : "value");
  const store = () =>
    keep(key, Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, input[part(input)]])));
  for (const [name, value] of Object.entries(kept(key, {}))) if (inputs[name]) inputs[name][part(inputs[name])] = value;
  for (const input of Object.values(inputs)) input.addEventListener("input", store);
}
