// Values of a run that goes on: tunable parameters and open inputs, each with a slider or what else fits its type.
import { make, number, visible } from './dom.js';

/** From where to where a slider goes: as declared, or around the value at the start; always with the present value. */
function bounds({ least, most, start, value, type }) {
  const span = Math.max(Math.abs(start) * 2, type === 'Integer' || !start ? 10 : 0);
  const declared = least !== null && most !== null && most - least <= 1e6 * Math.max(1, Math.abs(start)); // not that of the type
  const low = declared ? least : Math.max(least ?? -Infinity, start > 0 ? 0 : -span);
  const high = declared ? most : Math.min(most ?? Infinity, start < 0 ? 0 : span);
  return [Math.min(low, value), Math.max(high, value)];
}

export class ParametersPane {
  constructor(live) {
    this.live = live;
    this.input = make('input', { type: 'search', id: 'parameter', placeholder: 'Find: drone3 wind, mass, epsilon', spellcheck: false, autocomplete: 'off' });
    this.input.addEventListener('input', () => this.find(this.input.value));
    this.input.addEventListener('keydown', (event) => { event.stopPropagation(); if (event.key === 'Escape') this.input.blur(); });
    this.count = make('div', { class: 'dim' });
    this.refusal = make('div', { class: 'failure', id: 'refusal' });
    this.list = make('div', { class: 'parameters' });
    this.made = make('div', { class: 'made' });
    this.pane = make('section', { class: 'pane', id: 'pane-values', hidden: true }, this.input, this.count, this.refusal, this.list, this.made);
    this.told = 0;
  }

  find(text) {
    if (this.input.value !== text) this.input.value = text;
    this.live.ask('find', { text: text.slice(0, 200) });
  }

  show({ text, of, list, refusal }) {
    if (text !== this.input.value.slice(0, 200)) return;
    this.count.textContent = refusal || `${of} tunable parameters and inputs that nothing drives${list.length < of ? `, the first ${list.length} of them` : ''}`;
    this.list.replaceChildren(...list.map((one) => this.#row(one)));
  }

  refuse(reason) {
    this.refusal.textContent = visible(reason);
    if (reason) this.find(this.input.value); // the controls show the values that hold
  }

  #row(one) {
    const set = (value) => this.live.ask('set', { name: one.name, value: String(value) });
    const row = make('div', { class: 'parameter', title: visible(one.description), data: { name: one.name } }, make('div', {}, make('b', {}, visible(one.name)), make('span', { class: 'dim' }, visible(one.unit))));
    row.append(...this.#controls(one, set));
    if (one.description) row.append(make('div', { class: 'dim' }, visible(one.description)));
    return row;
  }

  #controls(one, set) {
    if (one.type === 'Boolean') {
      const box = make('input', { type: 'checkbox', checked: Boolean(one.value) });
      box.addEventListener('change', () => set(box.checked));
      return [box];
    }
    if (one.items.length) {
      const pick = make('select', {}, ...one.items.map((item) => make('option', { value: item }, visible(item))));
      pick.value = String(one.value);
      pick.addEventListener('change', () => set(pick.value));
      return [pick];
    }
    const field = make('input', { type: 'text', value: one.value === null ? '' : String(one.value), spellcheck: false });
    field.addEventListener('keydown', (event) => event.stopPropagation());
    field.addEventListener('change', () => set(field.value));
    if (!['Real', 'Integer'].includes(one.type) || typeof one.value !== 'number') return [field];
    const [min, max] = bounds(one);
    const slider = make('input', { type: 'range' });
    Object.assign(slider, { min: String(min), max: String(max), step: one.type === 'Integer' ? '1' : String((max - min) / 1000) });
    slider.value = String(one.value);
    slider.addEventListener('input', () => (field.value = String(one.type === 'Integer' ? Number(slider.value) : number(Number(slider.value), 4))));
    slider.addEventListener('change', () => set(field.value));
    slider.addEventListener('pointerup', () => slider.blur());
    slider.addEventListener('keydown', (event) => /^(Arrow|Page|Home|End)/.test(event.key) && event.stopPropagation()); // its own keys
    field.addEventListener('change', () => (slider.value = field.value));
    return [slider, field];
  }

  /** The values set so far, as options that repeat the run. */
  tell(changes) {
    const text = JSON.stringify(changes);
    if (text === this.text) return;
    this.text = text;
    const late = changes.filter(([time]) => time === null);
    const lines = changes.filter(([time]) => time !== null).map(([time, name, value]) => `--at ${time} '${name}=${value}'`);
    this.made.replaceChildren(...(lines.length ? [make('div', { class: 'dim' }, 'Set so far; these options repeat the run:'), make('pre', {}, visible(lines.join('\n')).replaceAll('\u240a', '\n'))] : []));
    if (late.length) this.made.append(make('div', { class: 'warning' }, visible(`The run ends before ${late.map(([, name]) => name).join(', ')} can be set.`)));
  }
}
