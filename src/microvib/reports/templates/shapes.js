// Shapes of modes that move on a canvas: in reports, which carry this script with them, and on the page.

const PERIOD = 2000; // of every mode, whatever its frequency [ms]
const TURN = 0.008; // by a pixel of dragging [rad]
const KEYS = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] };
const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]; // prettier-ignore
const SIGHT = "#d62728";

function made(tag, attributes, text = "") {
  const element = Object.assign(document.createElement(tag), attributes);
  element.append(text);
  return element;
}

function colour(part) {
  const place = 4 * Math.min(Math.max(part, 0), 1);
  const k = Math.min(3, Math.floor(place));
  return `rgb(${VIRIDIS[k].map((value, c) => Math.round(value + (place - k) * (VIRIDIS[k + 1][c] - value))).join(",")})`;
}

/**
 * Controls and canvas for points `xyz` [m] with `faces`, `lines` and lines of `sight` (indices of points), and `shapes`: how far
 * each point goes in each mode. {element, choose}: `choose(k)` shows the k-th mode.
 */
export function movingShapes({ xyz, faces, lines, sight = [], shapes, azimuth, elevation }) {
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const button = made("button", { type: "button" }, still ? "Play" : "Pause");
  const size = made("input", { type: "range", min: 0, max: 4, step: 0.05, value: 1 });
  const label = "Mode shape; drag it, or use the arrow keys, to turn it";
  const canvas = made("canvas", { tabIndex: 0, role: "img", ariaLabel: label, title: label, className: "shape" });
  Object.assign(canvas.style, { display: "block", width: "100%", height: "330px", cursor: "grab", touchAction: "none" });
  const amplitude = made("label", {}, " Amplitude ");
  amplitude.append(size);
  const [bar, element] = [made("p", { className: "bar" }), made("div", {})];
  bar.append(button, amplitude);
  element.append(bar, canvas);

  const g = canvas.getContext("2d");
  const middle = [0, 1, 2].map((c) => 0.5 * (Math.min(...xyz.map((p) => p[c])) + Math.max(...xyz.map((p) => p[c]))));
  const [across, upward] = [0, 1].map(reach);
  const farthest = Math.max(0, ...(shapes[0] ?? []).map((u) => Math.hypot(...u))); // all modes are scaled alike
  let shape = shapes[0] ?? [];
  let [phase, last, drag, playing] = [Math.PI / 2, null, null, !still];

  function turned(x, y, z) {
    const [c, s] = [Math.cos(azimuth), Math.sin(azimuth)];
    const away = x * c + y * s;
    const [up, level] = [Math.sin(elevation), Math.cos(elevation)];
    return [y * c - x * s, z * level - away * up, away * level + z * up]; // right, up, towards the eye
  }

  /** Middle and half of what is seen at rest, to the right (0) or up (1). */
  function reach(way) {
    const seen = xyz.map((p) => turned(...p.map((value, c) => value - middle[c]))[way]);
    const [low, high] = [Math.min(...seen), Math.max(...seen)];
    return { middle: 0.5 * (low + high), half: Math.max(0.5 * (high - low), 1e-9) };
  }

  function draw() {
    const [wide, high] = [canvas.clientWidth, canvas.clientHeight];
    const dense = devicePixelRatio || 1;
    if (!wide || !high) return;
    if (canvas.width !== Math.round(wide * dense)) Object.assign(canvas, { width: Math.round(wide * dense), height: Math.round(high * dense) });
    g.setTransform(dense, 0, 0, dense, 0, 0);
    g.clearRect(0, 0, wide, high);
    const scale = Math.min(wide / (across.half + farthest), high / (upward.half + farthest)) * 0.48;
    const a = Number(size.value) * Math.sin(phase);
    const far = shape.map((u) => Math.hypot(...u));
    const top = Math.max(...far, 1e-300);
    const points = xyz.map((p, k) => {
      const [right, up, near] = turned(...p.map((value, c) => value - middle[c] + a * (shape[k]?.[c] ?? 0)));
      return [wide / 2 + scale * (right - across.middle), high / 2 - scale * (up - upward.middle), near];
    });
    const sum = (face, of) => face.reduce((total, k) => total + of(k), 0);
    const ordered = [...faces].sort((p, q) => sum(p, (k) => points[k][2]) - sum(q, (k) => points[k][2]));
    g.lineWidth = 0.5;
    g.strokeStyle = "rgb(255 255 255 / 0.5)";
    for (const face of ordered) {
      g.fillStyle = colour((Math.abs(a) * sum(face, (k) => far[k])) / (face.length * top));
      path(face.map((k) => points[k]));
      g.closePath();
      g.fill();
      g.stroke();
    }
    g.lineCap = "round";
    stroke(lines, points, getComputedStyle(canvas).color, 2.5);
    stroke(sight, points, SIGHT, 3);
  }

  function path([first, ...rest]) {
    g.beginPath();
    g.moveTo(first[0], first[1]);
    for (const point of rest) g.lineTo(point[0], point[1]);
  }

  function stroke(pairs, points, style, width) {
    for (const pair of pairs) {
      const dot = pair[0] === pair[1]; // a point by itself
      Object.assign(g, { strokeStyle: style, lineWidth: dot ? 3 * width : width });
      path(pair.map((k) => points[k]));
      g.stroke();
    }
  }

  function step(now) {
    if (!playing) return (last = null);
    phase += last === null ? 0 : (2 * Math.PI * (now - last)) / PERIOD;
    last = now;
    draw();
    if (canvas.isConnected) requestAnimationFrame(step);
  }

  function turn(right, down) {
    azimuth -= TURN * right;
    elevation = Math.max(-1.5, Math.min(1.5, elevation + TURN * down));
    draw();
  }

  button.addEventListener("click", () => {
    playing = !playing;
    button.textContent = playing ? "Pause" : "Play";
    if (playing) requestAnimationFrame(step);
  });
  size.addEventListener("input", draw);
  canvas.addEventListener("keydown", (event) => {
    if (!KEYS[event.key]) return;
    event.preventDefault();
    turn(...KEYS[event.key]);
  });
  canvas.addEventListener("pointerdown", (event) => {
    drag = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointerup", () => (drag = null));
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) return;
    turn(event.clientX - drag[0], event.clientY - drag[1]);
    drag = [event.clientX, event.clientY];
  });
  new ResizeObserver(draw).observe(canvas);
  requestAnimationFrame(step);

  function choose(k) {
    shape = shapes[k];
    draw();
  }
  return { element, choose };
}
