// The first questions to the server, asked before the other scripts are there.

import * as scenario from "./scenario.js";

/** Catalog and fields; then the scenario of the address. */
export const loaded = scenario.load();
export const restored = loaded.then(() => scenario.restore());
for (const begun of [loaded, restored]) begun.catch(() => null); // the page says so, as soon as it can
