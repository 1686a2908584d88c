// Reads the recording that the page carries: a JSON document, and typed arrays in one compressed block.
import { LiveRun } from './live.js';

const TYPES = { f4: Float32Array, f8: Float64Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i2: Int16Array, i4: Int32Array };

async function inflate(id) {
  const text = document.getElementById(id).textContent.trim();
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** An array of the block: its bytes lie there as all first bytes, then all second ones, ... (they compress better). */
function typed(block, [offset, type, count]) {
  const Type = TYPES[type];
  const size = Type.BYTES_PER_ELEMENT;
  const array = new Type(count);
  const bytes = new Uint8Array(array.buffer);
  for (let k = 0; k < size; k++)
    for (let i = 0, from = offset + k * count; i < count; i++) bytes[i * size + k] = block[from + i];
  return array;
}

/** Times in s: the array has the steps between them, in units of `quantum`. */
function times(steps, start, quantum) {
  const found = new Float64Array(steps.length);
  let ticks = 0;
  for (let i = 0; i < steps.length; i++) found[i] = start + (ticks += steps[i]) * quantum;
  return found;
}

/** Numbers as they were before an origin was taken from them: of each of several columns, one behind the other. */
function placed(values, origin) {
  const length = values.length / origin.length;
  return Float64Array.from(values, (value, i) => value + origin[Math.floor(i / length)]);
}

export async function load() {
  const [head, block] = await Promise.all([inflate('run'), inflate('data')]);
  const run = JSON.parse(new TextDecoder().decode(head));
  if (run.live) {
    await new LiveRun(run).first;
    return readable(run);
  }
  const array = (place) => typed(block, place);
  run.rows = times(array(run.rows), run.start, run.quantum);
  const frames = array(run.motion.frames);
  run.motion.time = Float64Array.from(frames, (row) => run.rows[row]);
  run.motion.stride = frames.length; // from one column of a vehicle's array to the next
  run.vehicles.forEach((vehicle) => {
    for (const name of ['attitude', 'speed']) vehicle[name] = vehicle[name] && array(vehicle[name]);
    for (const name of ['position', 'desired', 'goal']) vehicle[name] = vehicle[name] && placed(array(vehicle[name]), vehicle.origin[name]);
  });
  const flights = run.traffic.flights;
  if (flights) {
    flights.sent = times(array(flights.sent), run.start, run.quantum);
    flights.delay = Float32Array.from(array(flights.delay), (ticks) => ticks * run.quantum);
    for (const name of ['from', 'to', 'message', 'lost']) flights[name] = array(flights[name]);
  }
  const log = run.traffic.log;
  if (log) {
    log.time = times(array(log.time), run.start, run.quantum);
    for (const name of ['source', 'message', 'heard', 'lost']) log[name] = array(log[name]);
  }
  const cache = new Map();
  /** Time and value of a signal, as recorded or thinned out: constants have one value. */
  run.curve = (index) => {
    if (!cache.has(index)) {
      const { rows, values, origin } = run.signals[index];
      const steps = rows && array(rows);
      const y = origin === undefined ? array(values) : placed(array(values), [origin]);
      let row = 0;
      const x = steps ? Float64Array.from(steps, (step) => run.rows[(row += step)]) : Float64Array.of(run.rows[0]);
      cache.set(index, { x, y });
    }
    return cache.get(index);
  };
  return readable(run);
}

/** What a recording and a run that goes on offer alike. */
function readable(run) {
  /** The value of a signal at a time: between two points on the line for real numbers, else that of the earlier one. */
  run.valueAt = (index, t) => {
    const { x, y } = run.curve(index);
    const i = before(x, t);
    if (run.signals[index].discrete || i + 1 >= x.length || t <= x[i]) return y[i];
    const u = (t - x[i]) / (x[i + 1] - x[i]);
    return Number.isNaN(y[i]) || Number.isNaN(y[i + 1]) ? y[u < 1 ? i : i + 1] : y[i] + (y[i + 1] - y[i]) * u;
  };
  run.index = new Map(run.signals.map((signal, index) => [signal.name, index]));
  return run;
}

/** Index of the last element up to `value` of an ascending array; 0 if there is none. */
export function before(array, value) {
  let low = 0;
  let high = array.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (array[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return Math.max(0, low - 1);
}
