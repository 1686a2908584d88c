// Curves of recorded signals over time, one below the other, with one time axis, one cursor and the present moment.
import uPlot from 'uplot';
import { make, number, visible, within } from './dom.js';

const MOST = 12; // curves in one plot
const CURVES = {
  dark: ['#56B4E9', '#E69F00', '#2FC79A', '#E88BBE', '#F0E442', '#FF7A45', '#9DB7FF', '#C9D3DC'],
  light: ['#0072B2', '#D55E00', '#00805C', '#B8478F', '#8A7400', '#A13D00', '#3F51B5', '#37474F'],
};
const DASHES = [undefined, [6, 4], [2, 3]];

export class Plots {
  constructor(run, { seek, colourOfSignal }) {
    this.run = run;
    this.seek = seek;
    this.colourOfSignal = colourOfSignal;
    this.sets = [];
    this.plots = [];
    this.range = null;
    this.list = make('div', { class: 'plots' });
    this.finder = this.#finder();
    this.pane = make('section', { class: 'pane', id: 'pane-plots' }, this.finder, this.list);
    new ResizeObserver(() => this.#resize()).observe(this.list);
  }

  /** Signals whose name has all words of a text; a word with * is a pattern. */
  find(text, most = Infinity) {
    const words = text.toLowerCase().split(/\s+/).filter(Boolean).map((word) => {
      if (!word.includes('*')) return (name) => name.includes(word);
      const pattern = new RegExp(word.split('*').map((part) => part.replace(/[.*+?^${}()|[\]\\]/g, '\\$&')).join('.*'));
      return (name) => pattern.test(name);
    });
    const found = [];
    for (let i = 0; i < this.run.signals.length && found.length < most; i++) {
      const name = (this.run.signals[i].lower ??= this.run.signals[i].name.toLowerCase());
      if (words.every((word) => word(name))) found.push(i);
    }
    return found;
  }

  #finder() {
    const input = make('input', { type: 'search', placeholder: `Plot any of ${this.run.signals.length} signals: drone2 position`, id: 'find', autocomplete: 'off', spellcheck: false });
    const list = make('ul', { hidden: true });
    let found = [];
    let at = -1;
    const draw = () => {
      found = this.find(input.value, 200);
      const items = found.map((index, k) => {
        const { name, unit, description } = this.run.signals[index];
        const item = make('li', { title: visible(description || '') }, visible(name), make('small', {}, visible(unit)));
        item.setAttribute('aria-selected', String(k === at));
        item.addEventListener('mousedown', (event) => {
          event.preventDefault();
          this.add([index], event.shiftKey);
          close();
        });
        return item;
      });
      if (found.length > 1) {
        const several = make('li', {}, `all ${Math.min(found.length, MOST)} of these in one plot`);
        several.setAttribute('aria-selected', 'false');
        several.addEventListener('mousedown', (event) => {
          event.preventDefault();
          this.add(found.slice(0, MOST));
          close();
        });
        items.unshift(several);
      }
      if (!found.length) items.push(make('li', { class: 'dim' }, 'no signal has these words'));
      list.replaceChildren(...items);
      list.hidden = false;
    };
    const close = () => {
      list.hidden = true;
      input.value = '';
      input.blur();
    };
    input.addEventListener('input', () => { at = -1; draw(); });
    input.addEventListener('focus', draw);
    input.addEventListener('blur', () => (list.hidden = true));
    input.addEventListener('keydown', (event) => {
      event.stopPropagation();
      if (event.key === 'Escape') close();
      else if (event.key === 'Enter' && found.length) {
        if (at >= 0) this.add([found[at]], event.shiftKey);
        else this.add(found.slice(0, MOST));
        close();
      } else if (event.key === 'ArrowDown' || event.key === 'ArrowUp') {
        at = Math.max(-1, Math.min(found.length - 1, at + (event.key === 'ArrowDown' ? 1 : -1)));
        draw();
        list.children[at + 1]?.scrollIntoView({ block: 'nearest' });
        event.preventDefault();
      }
    });
    return make('div', { class: 'finder' }, input, list);
  }

  /** A new plot of signals, or these in the last plot. */
  add(signals, toLast = false) {
    if (!signals.length) return;
    if (toLast && this.sets.length) {
      const last = this.sets.at(-1);
      for (const signal of signals) if (!last.includes(signal) && last.length < MOST) last.push(signal);
    } else this.sets.push(signals.slice(0, MOST));
    this.draw();
    this.list.lastElementChild?.scrollIntoView({ block: 'nearest' });
  }

  set(sets) {
    this.sets = sets.map((set) => set.slice(0, MOST));
    this.draw();
  }

  /** What is drawn, for whoever wants to read it. */
  shown() {
    return this.plots.map(({ set, data }) => ({
      signals: set.map((index) => this.run.signals[index].name),
      time: [...data[0]],
      values: data.slice(1).map((values) => [...values]),
    }));
  }

  draw() {
    for (const { plot } of this.plots) plot.destroy();
    this.plots = this.sets.map((set, k) => this.#plot(set, k));
    this.list.replaceChildren(...this.plots.map(({ element }) => element));
    this.#resize();
    this.update(this.t ?? this.run.start);
  }

  #data(set) {
    const end = this.run.rows.at(-1) ?? this.run.start;
    const tables = set.map((index) => {
      const { x, y } = this.run.curve(index);
      const every = this.run.live ? Math.ceil(x.length / 3000) : 1; // drawn anew all the time
      const some = (array) => (every > 1 ? array.filter((_, i) => i % every === 0 || i === array.length - 1) : array);
      const values = Array.from(some(y), (v) => (Number.isFinite(v) ? v : null));
      const at = Array.from(some(x));
      if (at.at(-1) < end) {
        at.push(end);
        values.push(values.at(-1));
      }
      return [at, values];
    });
    return tables.length === 1 ? tables[0] : uPlot.join(tables);
  }

  #plot(set, k) {
    const data = this.#data(set);
    const style = getComputedStyle(document.documentElement);
    const [dim, line] = ['--dim', '--line'].map((name) => style.getPropertyValue(name).trim());
    const theme = document.documentElement.dataset.theme;
    const own = set.map((index) => this.colourOfSignal(index));
    const distinct = new Set(own).size === own.length && !own.includes(null);
    const strokes = set.map((_, i) => (distinct ? own[i] : CURVES[theme][i % CURVES[theme].length]));
    const signals = set.map((index) => this.run.signals[index]);
    const body = make('div', { class: 'body' });
    const header = make('header');
    const element = make('div', { class: 'plot' }, header, make('button', { class: 'close', title: 'remove this plot', onclick: () => { this.sets.splice(k, 1); this.draw(); } }, '×'), body);
    const axis = { stroke: dim, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1 }, font: '12px system-ui, "DejaVu Sans", sans-serif' };
    const items = signals[0].items && set.length === 1 ? new Map(signals[0].items.map(([word, value]) => [value, word])) : null;
    const plot = new uPlot(
      {
        width: 300,
        height: 150,
        legend: { show: false },
        cursor: { sync: { key: 'time', setSeries: false }, drag: { x: true, y: false }, points: { size: 6 } },
        scales: { x: { time: false, range: (_, min, max) => this.range ?? [min, max > min ? max : min + 1] } },
        axes: [
          { ...axis, size: 26, gap: 3, values: (_, ticks) => ticks.map((v) => `${number(v)}`) },
          { ...axis, size: items ? 78 : 56, gap: 3, values: (_, ticks) => ticks.map((v) => (items ? (Number.isInteger(v) ? visible(items.get(v) ?? String(v)) : '') : number(v, 6))) },
        ],
        series: [
          {},
          ...signals.map((signal, i) => ({
            stroke: strokes[i],
            width: 1.8,
            dash: DASHES[distinct ? 0 : Math.floor(i / 8) % 3],
            spanGaps: true,
            paths: signal.discrete ? uPlot.paths.stepped({ align: 1 }) : undefined,
            points: { show: false },
          })),
        ],
        hooks: {
          setScale: [(u, key) => key === 'x' && this.#zoomed(u)],
          draw: [() => this.#now()],
        },
      },
      data,
      body,
    );
    const now = make('div', { class: 'now' });
    plot.over.append(now);
    let pressed = null;
    plot.over.addEventListener('mousedown', (event) => {
      pressed = event.offsetX;
      this.dragging = true;
      addEventListener('mouseup', () => setTimeout(() => (this.dragging = false)), { once: true });
    });
    plot.over.addEventListener('mouseup', (event) => {
      if (pressed !== null && Math.abs(event.offsetX - pressed) < 3) this.seek(plot.posToVal(event.offsetX, 'x'));
      pressed = null;
    });
    plot.over.addEventListener('dblclick', () => this.zoom(null));
    const { title: common, names } = shortened(signals.map((signal) => signal.name));
    if (common) header.append(make('em', {}, visible(common), signals.every((one) => one.unit === signals[0].unit) && signals[0].unit ? visible(` [${signals[0].unit}]`) : ''));
    const values = signals.map((signal, i) => {
      const value = make('b');
      const unit = signal.unit ? ` [${signal.unit}]` : '';
      const title = `${visible(signal.name)}${visible(unit)}: ${visible(signal.description || '')}\n(click to remove)`;
      header.append(make('span', { title, onclick: () => { set.splice(i, 1); if (!set.length) this.sets.splice(k, 1); this.draw(); } }, make('i', { style: { background: strokes[i] } }), visible(names[i]), ' ', value));
      return value;
    });
    return { set, data, plot, element, now, values, range: spread(data), common };
  }

  #zoomed(u) {
    if (this.zooming || (this.run.live && !this.dragging)) return; // the range also changes with every value that comes in
    const { min, max } = u.scales.x;
    const [first, last] = [this.run.rows[0], this.run.rows.at(-1)];
    const whole = [first, last > first ? last : first + 1];
    if (min === undefined || min === null) return;
    if (Math.abs(min - whole[0]) < 1e-9 && Math.abs(max - whole[1]) < 1e-9) return;
    if (this.range && this.range[0] === min && this.range[1] === max) return;
    queueMicrotask(() => this.zoom([min, max]));
  }

  /** Show a stretch of time in all plots; null: all of it. */
  zoom(range) {
    this.zooming = true;
    this.range = range;
    for (const { plot } of this.plots) plot.setData(plot.data);
    this.zooming = false;
  }

  #resize() {
    const width = Math.max(120, this.list.clientWidth);
    const few = Math.max(1, Math.min(4, this.plots.length));
    const height = Math.max(120, Math.min(230, (this.pane.clientHeight - 60) / few - 34));
    for (const { plot } of this.plots) if (width !== plot.width || Math.abs(height - plot.height) > 2) plot.setSize({ width, height });
    this.#now();
  }

  #now() {
    for (const { plot, now } of this.plots) {
      const x = plot.valToPos(this.t, 'x');
      now.hidden = !(x >= 0 && x <= plot.over.clientWidth);
      now.style.transform = `translateX(${x - 1}px)`;
    }
  }

  update(t) {
    this.t = t;
    if (this.pane.hidden) return;
    this.#now();
    for (const { set, values, range, common } of this.plots) {
      set.forEach((index, i) => {
        const signal = this.run.signals[index];
        values[i].textContent = `${visible(said(signal, this.run.valueAt(index, t), range, common))}`;
      });
    }
  }

  repaint() {
    this.draw();
  }

  /** Take over values that have come in. */
  refresh() {
    if (this.pane.hidden) return;
    for (const one of this.plots) {
      one.data = this.#data(one.set);
      one.range = spread(one.data);
      one.plot.setData(one.data);
    }
    this.#now();
  }
}

/** From the least to the greatest value of the curve that varies most. */
function spread(data) {
  const ranges = data.slice(1).map((column) => {
    const finite = column.filter((v) => Number.isFinite(v));
    return finite.reduce((a, b) => Math.max(a, b), -Infinity) - finite.reduce((a, b) => Math.min(a, b), Infinity);
  });
  return Math.max(...ranges);
}

/** A value with its unit, or the word of an enumeration. */
export function said(signal, value, range = 0, bare = false) {
  if (signal.texts) return signal.texts[value] ?? '';
  const item = signal.items?.find(([, v]) => v === value);
  if (item) return item[0];
  if (signal.boolean) return value ? 'true' : 'false';
  return `${within(value, range)}${signal.unit && !bare ? ` ${signal.unit}` : ''}`;
}

/** What names have in common at their end, whole words of it, and what is left of each of them. */
function shortened(names) {
  const words = names.map((name) => name.split('.'));
  let k = 0;
  const shortest = Math.min(...words.map((one) => one.length)) - 1;
  while (names.length > 1 && k < shortest && words.every((one) => one.at(-1 - k) === words[0].at(-1 - k))) k++;
  return k ? { title: words[0].slice(-k).join('.'), names: words.map((one) => one.slice(0, -k).join('.')) } : { title: '', names };
}
