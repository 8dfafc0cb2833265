// How recordings are prepared before they are processed: a preparation file's text, and the tables that it names.

import { describedField, sentTables } from "./described.js";
import { h } from "./dom.js";
import { keepFields } from "./kept.js";

const YAML = ".yaml,.yml,text/yaml";
const EXAMPLE = "table_frf:\n  file: frf.csv\n  mounted_mass: 12 kg\n  test_mass: 12 kg";
const BLOCK = /^table_frf:.*\n?(?:[ \t]+.*\n?)*/m;

/** The form, folded while nothing is in it. */
export function makePreparation() {
  const text = describedField("recording-prepare", "Preparation file (YAML), as of --prepare", { placeholder: EXAMPLE, rows: 5, accept: YAML, title: "Units, axes, an offset of the torques, the chain's and the force table's response; background names a recording of this page" });
  const tables = sentTables("recording.tables", "recording-tables", "Tables that it names (CSV)");
  const details = h(
    "details",
    { class: "more" },
    h("summary", {}, "Preparation: force table, axes, offset, units"),
    h("p", { class: "soft note" }, "Taken for all that is made of recordings on this tab; the time history shows them as they are. No file is opened that is not chosen here."),
    h("div", { class: "descriptions" }, text.element, tables.element),
  );
  keepFields("recording.preparation", { prepare: text.input });
  details.open = Boolean(text.input.value.trim());

  function set(words) {
    text.input.value = words;
    text.input.dispatchEvent(new Event("input", { bubbles: true }));
    details.open ||= Boolean(words.trim());
  }

  return {
    element: details,
    /** What a request says. */
    asked: () => (text.input.value.trim() ? { prepare: text.input.value, tables: tables.texts() } : {}),
    /** Put into the fields what a request of before said. */
    take: ({ prepare = "", tables: sent = {} }) => {
      Object.entries(sent).forEach(([name, content]) => tables.add(name, content));
      set(prepare);
    },
    /** Correct recordings by the response of a table (CSV) that was measured with a mass on it, such as "12 kg". */
    correctBy: (response, mass) => {
      tables.add("frf.csv", response);
      const others = text.input.value.replace(BLOCK, "").trimEnd();
      const block = `table_frf:\n  file: frf.csv\n  mounted_mass: ${mass}\n  test_mass: ${mass}  # on the table in the recordings`;
      set(`${others}${others && "\n"}${block}\n`);
    },
  };
}
