// What runs have: channels, some more than others, and an array mode that the drive excites.

import { h } from "./dom.js";

export const has = (run, name) => run.result.channels.some((channel) => channel.name === name);

/** Bring a select in line with the channels of the runs. */
export function fillChannels(select, runs, value) {
  const found = new Map(runs.flatMap((run) => run.result.channels.map((channel) => [channel.name, channel])));
  if (!found.size || [...select.options].map((option) => option.value).join() === [...found.keys()].join()) return;
  const option = ({ name, meaning }) => h("option", { value: name, title: meaning }, `${name}  ${meaning}`);
  select.replaceChildren(...[...found.values()].map(option));
  select.value = value;
}

/** The mode that the drive excites most, of the array or of a craft: the one whose line is largest; without any line, the first. */
export function excited(result) {
  const lines = (result?.lines ?? []).filter((line) => line.kind === "array mode" && line.status !== "below the floor");
  const top = lines.sort((a, b) => (b.amplitude_n_m ?? 0) - (a.amplitude_n_m ?? 0))[0];
  const modes = (result?.modes ?? []).filter((mode) => /_mode_\d+$/.test(mode.name));
  return modes.find((mode) => mode.name === top?.line) ?? modes[0];
}
