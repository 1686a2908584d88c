// A run that goes on: its frames become the arrays that everything else reads, and requests go back to it.

const NUMBERS = 8_000_000; // of all signals at all instants kept; with more, every second instant is dropped
const [FEWEST, MOST] = [600, 20_000];

import { $ } from './dom.js';
import { LiveRadio } from './radio.js';

export class LiveRun {
  /** Fill in what a recording would have, for a document without values. */
  constructor(run) {
    this.run = run;
    this.room = Math.max(FEWEST, Math.min(MOST, Math.floor(NUMBERS / Math.max(1, run.signals.length))));
    this.n = 0;
    this.paused = false;
    this.speed = null;
    this.ended = null; // words and class of the style sheet, when the run has ended
    this.over = false; // nothing comes any more
    this.dropped = 0; // how often every second instant was dropped
    this.walls = [];
    this.columns = run.signals.map(() => new Float64Array(this.room));
    this.time = new Float64Array(this.room);
    run.motion = { stride: this.room };
    if (run.traffic.live) this.radio = new LiveRadio(run);
    for (const vehicle of run.vehicles) {
      const { columns } = vehicle;
      for (const name of ['position', 'desired', 'attitude']) if (columns[name]) vehicle[name] = new Float64Array(columns[name].length * this.room);
      if (columns.goal) vehicle.goal = new Float64Array(this.room);
      if (columns.speed?.length) vehicle.speed = new Uint8Array(this.room);
      vehicle.top = 1e-9;
    }
    run.curve = (index) => ({ x: run.rows, y: this.columns[index].subarray(0, this.n) });
    this.#grown();
    this.onframe = this.onstate = this.onlinks = this.onparameters = this.onrefusal = this.onverdict = () => {};
    this.changes = [];
    this.said = [0, '']; // what became of the last request to send a vehicle somewhere
    this.first = new Promise((resolve, reject) => Object.assign(this, { begun: resolve, missed: reject }));
    $('empty').textContent = 'The run is starting.';
    $('empty').hidden = false;
    this.first.then(() => ($('empty').hidden = true), () => {});
    this.#connect(run.live.address);
    run.live = this;
  }

  #connect(address) {
    this.socket = new WebSocket(address);
    this.socket.binaryType = 'arraybuffer';
    this.socket.addEventListener('message', ({ data }) => {
      if (typeof data === 'string') this.#told(JSON.parse(data));
      else if (new Float64Array(data, 0, 1)[0] >= -Infinity) this.#take(new Float64Array(data));
      else this.radio.fly(new Float64Array(data, 8));
    });
    this.socket.addEventListener('close', () => {
      this.over = true;
      this.missed(new Error('the run ended before it sent anything'));
      this.onstate();
    });
  }

  #told(news) {
    if (news.messages) return this.radio.say(news.messages, news.sends);
    if (news.links) {
      this.radio.count(news.links);
      return this.onlinks();
    }
    if (news.verdict) {
      this.run.verdict = news.verdict;
      return this.onverdict();
    }
    if (news.parameters) return this.onparameters(news.parameters);
    if (news.refusal !== undefined) return this.onrefusal(news.refusal);
    Object.assign(this, news);
    return this.onstate();
  }

  /** Ask something of the run. */
  ask(what, more = {}) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ do: what, ...more }));
  }

  #take(frame) {
    const [time, wall] = frame;
    if (this.n && time < this.time[this.n - 1]) return;
    if (!this.n || time > this.time[this.n - 1]) {
      if (this.n === this.room) this.#halve();
      this.n++;
    }
    const i = this.n - 1;
    const { room } = this;
    this.time[i] = time;
    this.columns.forEach((column, k) => (column[i] = frame[k + 2]));
    for (const vehicle of this.run.vehicles) {
      const { columns } = vehicle;
      for (const name of ['position', 'desired', 'attitude']) columns[name]?.forEach((k, axis) => (vehicle[name][axis * room + i] = frame[k + 2]));
      if (columns.goal) vehicle.goal[i] = frame[columns.goal[1] + 2] > 0 ? frame[columns.goal[0] + 2] : NaN;
      if (vehicle.speed) {
        const mean = Math.abs(columns.speed.reduce((sum, k) => sum + frame[k + 2], 0) / columns.speed.length);
        vehicle.top = Math.max(vehicle.top, mean || 0);
        vehicle.speed[i] = Math.round(((mean || 0) / vehicle.top) * 255);
      }
    }
    this.walls.push([time, wall]);
    if (this.walls.length > 60) this.walls.shift();
    this.#grown();
    const drawn = () => this.ask('drawn');
    if (document.hidden) drawn();
    else requestAnimationFrame(drawn);
    this.begun();
    this.onframe();
  }

  #grown() {
    const { run } = this;
    run.rows = run.motion.time = this.time.subarray(0, this.n);
    run.end = this.n ? this.time[this.n - 1] : run.start;
    if (this.n) run.start = this.time[0];
  }

  /** Drop every second instant: the page may stay open for days. */
  #halve() {
    const kept = Math.ceil(this.n / 2);
    const halve = (array, columns = 1) => {
      for (let c = 0; c < columns; c++) for (let i = 0; i < kept; i++) array[c * this.room + i] = array[c * this.room + 2 * i];
    };
    halve(this.time);
    this.columns.forEach((column) => halve(column));
    for (const vehicle of this.run.vehicles) {
      for (const name of ['position', 'desired', 'attitude']) if (vehicle[name]) halve(vehicle[name], vehicle.columns[name].length);
      for (const name of ['goal', 'speed']) if (vehicle[name]) halve(vehicle[name]);
    }
    this.n = kept;
    this.dropped++;
  }

  /** How many times real time the run goes, over the last frames. */
  get factor() {
    const [first, last] = [this.walls[0], this.walls.at(-1)];
    return first && last[1] > first[1] ? (last[0] - first[0]) / (last[1] - first[1]) : null;
  }

}
