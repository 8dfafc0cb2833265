// The Run tab: chips of the runs, drawing, plots and tables of the chosen one.

import * as ab from "./ab.js";
import { craftOf } from "./craft.js";
import { announce, h, s } from "./dom.js";
import { drawing as driveOf } from "./drive.js";
import { drawingExports } from "./downloads.js";
import * as history from "./history.js";
import * as limit from "./limit.js";
import { exportMenu } from "./exports.js";
import { latest } from "./latest.js";
import * as live from "./live.js";
import { onUnits, shownFact } from "./measures.js";
import { progressRow } from "./progress.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { makeSlowMotion } from "./slow.js";
import * as spectrum from "./spectrum.js";
import * as sweep from "./sweep.js";
import { partCards } from "./tables.js";

const bars = new Map();
const drawing = latest();
const chips = h("ul", { class: "chips", "aria-label": "Runs" });
const going = h("div", { class: "going", hidden: true });
const head = h("div", { class: "head" });
const picture = h("section", { class: "card drawing" });
const caption = h("p", { class: "soft note" });
const sketch = h("div", { class: "wide", tabindex: "0", role: "region", "aria-label": "Drive train" });
const figures = h("div", { class: "figures" }, spectrum.card);
const answer = h("div", { class: "tables" });
const craft = h("div", {});
const tables = h("div", { class: "tables" });

const FILES = [
  ["scenario.yaml", "scenario"],
  ["lines.csv", "lines (CSV)"],
  ["seeds.csv", "lines over the seeds (CSV)"],
  ["loads.csv", "loads on the hub (CSV)"],
  ["pointing.csv", "line of sight (CSV)"],
  ["densities.csv", "densities of both (CSV)"],
  ["lines_wing_2.csv", "lines of the second wing's drive (CSV)"],
  ["loads_wing_2.csv", "loads of the second wing (CSV)"],
  ["summary.json", "summary"],
  ["motion.nc", "data set (netCDF)"],
  ["report.html", "report (HTML)"],
  ["report.pdf", "report (PDF)"],
];

export function makeRun(place) {
  const slow = makeSlowMotion(showDrawing);
  picture.append(sketch, slow, caption, drawingExports(() => sketch.querySelector("svg"), "Drive train"));
  live.makeLive();
  sweep.makeSweep();
  place.append(chips, going, head, limit.bar, figures, answer, ab.card, history.card, live.card, sweep.card, craft, picture, tables);
  limit.makeLimit(judged);
  runs.onChange((what) => {
    if (what === "runs") return show();
    if (what === "names") return redraw();
    if (what === "state") showChips();
    showProgress();
  });
  onUnits(redraw);
  scenario.onCheck(() => !runs.selected()?.result && showDrawing());
  show();
}

async function show() {
  showChips();
  showProgress();
  showDrawing();
  limit.update();
  const run = runs.selected();
  head.replaceChildren(...(run ? [...(run.result ? headOf(run) : []), ...failure(run)] : [welcome()]));
  craft.replaceChildren(...craftOf(run));
  showTables(run);
  const shown = runs.shown();
  const names = shown.map((item) => item.id).join(" ");
  spectrum.card.hidden = history.card.hidden = !shown.length;
  if (!shown.length || names === figures.dataset.drawn) return ab.update();
  figures.dataset.drawn = "";
  await drawing(
    async () => {
      await spectrum.update().finally(ab.update); // whose verdicts the picture does not wait for
      performance.mark("run-drawn"); // the picture that is seen first
      await history.update();
    },
    () => (figures.dataset.drawn = names),
  ).catch((error) => announce(error.message, { error: true }));
}

/** Names have changed: chips, legends, and what says whose figures these are. */
function redraw() {
  figures.dataset.drawn = "";
  return show();
}

/** The limit, or what is said against it, has changed. */
function judged() {
  const run = runs.selected();
  ab.update();
  if (run?.result) {
    showTables(run);
    head.replaceChildren(...headOf(run), ...failure(run));
  }
  if (run?.state === "done") spectrum.update().catch((error) => announce(error.message, { error: true }));
}

function welcome() {
  return h(
    "p",
    { class: "welcome" },
    "Choose a scenario, change what you like, and press ",
    h("b", {}, "Run"),
    ". Lines, spectrum and time history appear here; each further run is drawn over the others. With a data sheet in hand, begin ",
    h("button", { type: "button", onclick: () => document.getElementById("tab-sheet").click() }, "from a data sheet"),
    ".",
  );
}

/** What became of a run that did not end as it should, or whose samples are lost. */
function failure(run) {
  const ends = {
    failed: `failed: ${run.error}`,
    cancelled: run.unwanted ? "was cancelled." : "was cancelled, by another tab or because the server ended.",
    gone: "is no longer on the server, which was restarted or dropped the run to make room for newer ones.",
  };
  if (!ends[run.state]) return [];
  const again = () => runs.again(run).catch((error) => announce(error.message, { error: true }));
  return [
    h(
      "p",
      { class: run.unwanted ? "soft" : "error block" },
      `${run.name} ${ends[run.state]} `,
      run.scenario && h("button", { type: "button", onclick: again }, "Run it again"),
    ),
  ];
}

function showDrawing(now = null) {
  const run = runs.selected();
  const done = run?.result;
  sketch.replaceChildren(driveOf(done, done ? done.values : scenario.checked().values, done && now));
  const widths = now ? "its distance from its mean" : "its amplitude ∿ at the driving frequency f_d";
  caption.textContent = done
    ? `Each arrow's head is on the body that the torque acts on; positive is one sense about the drive axis. What the housing feels adds up to T_d. An arrow's width goes with ${widths}, by decades.`
    : "After a run this drawing carries its voltages, currents and torques.";
}

/** The chips anew; the button that has the focus has it afterwards, too. */
function showChips() {
  const had = chips.contains(document.activeElement) ? document.activeElement : null;
  const place = had && `[data-run="${had.closest(".chip").dataset.run}"] .${had.className}`;
  fillChips();
  if (place) chips.querySelector(place)?.focus();
}

function fillChips() {
  chips.replaceChildren(
    ...runs.all().map((run) => {
      const state = runs.going(run) ? "" : run.state === "done" ? "" : ` (${run.state})`;
      const eye =
        run.state === "done" &&
        h(
          "button",
          {
            class: "eye",
            "aria-pressed": String(run.visible),
            title: run.visible ? "Hide in the plots" : "Show in the plots",
            "aria-label": `Show ${run.name} in the plots`,
            onclick: () => runs.toggle(run),
          },
          run.visible ? "●" : "○",
        );
      const name = h(
        "button",
        { class: "name", "aria-pressed": String(run === runs.selected()), title: `${run.name}; F2 renames it`, onclick: () => runs.choose(run), onkeydown: (event) => event.key === "F2" && rename(run) },
        sample(run),
        h("span", {}, run.name + state),
      );
      const pen =
        run === runs.selected() &&
        h("button", { class: "pen", title: "Rename (F2)", "aria-label": `Rename ${run.name}`, onclick: () => rename(run) }, "✎");
      const close = h(
        "button",
        { class: "close", title: "Close; it stays in the library", "aria-label": `Close ${run.name}`, onclick: () => runs.remove(run) },
        "×",
      );
      return h("li", { "data-run": run.look, class: `chip ${run.state}${run === runs.selected() ? " chosen" : ""}` }, eye, name, pen, close);
    }),
  );
}

/** A field in the place of a run's name. */
function rename(run) {
  const place = chips.querySelector(`[data-run="${run.look}"]`);
  const field = h("input", { type: "text", class: "rename", "aria-label": "Name of the run", value: run.name, maxlength: 200 });
  let over = false;
  const end = (name) => {
    if (over) return;
    over = true;
    runs.rename(run, name);
    showChips();
    chips.querySelector(`[data-run="${run.look}"] .name`)?.focus();
  };
  field.addEventListener("keydown", (event) => {
    if (!["Enter", "Escape"].includes(event.key)) return;
    event.preventDefault(); // the button that gets the focus is not pressed by it
    end(event.key === "Enter" ? field.value : run.name);
  });
  field.addEventListener("blur", () => end(field.value));
  place.querySelector(".name").replaceWith(field);
  field.select();
}

/** The run's colour and dash, as in the plots. */
function sample(run) {
  const dashes = { solid: "", dash: "7 4", dot: "2 3", dashdot: "7 3 2 3", longdash: "11 4", longdashdot: "11 3 2 3" };
  return s(
    "svg",
    { width: 26, height: 8, "aria-hidden": "true" },
    s("path", { d: "M0 4H26", stroke: run.colour, "stroke-width": 3, "stroke-dasharray": dashes[run.dash] }),
  );
}

/** One bar for each run that is under way; kept in place while it moves, so that its button can be pressed. */
function showProgress() {
  const active = runs.all().filter(runs.going);
  going.hidden = !active.length;
  for (const [id, row] of bars) {
    if (active.some((run) => run.id === id)) continue;
    row.element.remove();
    bars.delete(id);
  }
  for (const run of active) {
    if (!bars.has(run.id)) {
      bars.set(
        run.id,
        progressRow(run.name, () => runs.cancel(run)),
      );
      going.append(bars.get(run.id).element);
    }
    bars.get(run.id).show(run);
  }
}

/** The leading figures of a run: verdict or largest lines, largest torque. */
function headOf(run) {
  const { facts } = limit.verdictOf(run) ?? run.result;
  const fact = ({ value, label, status }) => h("div", { class: status, title: label }, h("b", {}, shownFact({ value, label }).replaceAll("-", "−")), h("span", {}, label));
  return [
    h("div", { class: "facts" }, h("h2", {}, run.result.title || run.name), facts.map(fact), run.state === "done" && h("div", { class: "menus" }, menu(run), exportMenu(run))),
  ];
}

/** The lines stand under their picture, everything else further below. */
function showTables(run) {
  const [lines, ...others] = run?.result ? tablesOf(run) : [];
  answer.replaceChildren(...(lines ? [lines] : []));
  tables.replaceChildren(...others);
}

/** Cards of the run's parts; those that the limit changes as they are against it. */
function tablesOf(run) {
  const judged = new Map(limit.verdictOf(run)?.parts.map((part) => [part.title, part]));
  const parts = run.result.parts.map((part) => judged.get(part.title) ?? part);
  const [first, ...others] = parts;
  return partCards([...others, { ...first, title: "What was simulated" }]);
}

function menu(run) {
  const asked = Object.entries(limit.query()).filter(([, value]) => value);
  const search = limit.verdictOf(run) ? `?${new URLSearchParams(asked)}` : "";
  const address = (file) => `/api/runs/${run.id}/files/${file}${file.startsWith("report.") ? search : ""}`;
  const there = ([file]) => run.result.files.includes(file) || !file.endsWith(".csv");
  const links = FILES.filter(there).map(([file, words]) => h("a", { href: address(file), download: file }, words));
  return h("details", { class: "menu files" }, h("summary", { class: "button" }, "Download"), h("div", {}, links));
}
