// Colours and dashes of curves: no two alike, however many there are.

// Okabe and Ito's colours, which colour-blind people can tell apart, then further ones; a dash for those who see none.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#882255", "#999933", "#AA4499", "#44AA99"];
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];
const GOLDEN = 137.508; // degrees: hues that never come back to one another

/** Colour and dash of the k-th curve. */
export const style = (k) => [COLOURS[k] ?? `hsl(${((k * GOLDEN) % 360).toFixed(2)} 62% 47%)`, DASHES[k % DASHES.length]];

/** The first number that is not taken. */
style.free = (taken) => {
  for (let k = 0; ; k++) if (!taken.includes(k)) return k;
};

// What is drawn beside runs, in none of their colours.
export const PHASE = { i_A: ["#A6761D", "solid"], i_B: ["#7570B3", "solid"], i_ref_A: ["#D8A657", "dot"], i_ref_B: ["#B3AEDC", "dot"] };
export const STICK = { stuck_output: ["#7F9183", "shaft sticks"], stuck_rotor: ["#C25B6E", "rotor sticks"] };
export const RECORDED = "#5D4A8A";
export const LINE = "#B8336A"; // what was found in a recording
export const BACKGROUND = "#7A7F87"; // what is there with the drive off
export const LIMIT = "#B3261E";
