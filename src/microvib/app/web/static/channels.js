// Which channels there are to choose from: those of all shown runs; some have more than others.

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
