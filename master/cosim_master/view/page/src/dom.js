// Elements of the page. Text from a recording only ever becomes text: nothing here takes markup.

/** An element with properties and children; strings become text nodes. */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === 'class') element.className = value;
    else if (name === 'style') Object.assign(element.style, value);
    else if (name === 'data') Object.assign(element.dataset, value);
    else if (name.startsWith('aria-') || name === 'role') element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export const $ = (id) => document.getElementById(id);

/** A number for people: as many digits as say something. */
export function number(value, digits = 5) {
  if (value === null || value === undefined) return '';
  if (!Number.isFinite(value)) return String(value);
  if (Number.isInteger(value) && Math.abs(value) < 1e9) return String(value);
  return String(Number(value.toPrecision(digits)));
}

/** A number with as many decimals as say something where numbers differ by `range`. */
export function within(value, range) {
  if (!Number.isFinite(value)) return String(value);
  if (Number.isInteger(value) && Math.abs(value) < 1e9) return String(value);
  if (!(range > 0) || Math.abs(value) > 1e6 * range) return number(value);
  const digits = Math.max(0, Math.min(9, 4 - Math.ceil(Math.log10(range))));
  return digits > 6 ? value.toExponential(2) : value.toFixed(digits);
}

/** Control characters made visible, as pictures of them. */
export const visible = (text) => text.replace(/[\u0000-\u001f\u007f]/g, (c) => (c === '\u007f' ? '\u2421' : String.fromCharCode(0x2400 + c.charCodeAt(0))));

/** Rows of equal height, of which only those in sight are elements. */
export class Rows {
  constructor(render, height = 22) {
    this.render = render;
    this.height = height;
    this.space = make('div', { class: 'space' });
    this.element = make('div', { class: 'rows', tabIndex: 0 }, this.space);
    this.element.addEventListener('scroll', () => this.draw());
    new ResizeObserver(() => this.draw()).observe(this.element);
    this.items = [];
  }

  set(items) {
    this.items = items;
    this.space.style.height = `${Math.max(1, items.length * this.height)}px`;
    this.draw();
  }

  draw() {
    const first = Math.max(0, Math.floor(this.element.scrollTop / this.height) - 4);
    const last = Math.min(this.items.length, first + Math.ceil(this.element.clientHeight / this.height) + 8);
    const shown = [];
    for (let i = first; i < last; i++) {
      const row = this.render(this.items[i], i);
      row.style.top = `${i * this.height}px`;
      shown.push(row);
    }
    this.space.replaceChildren(...shown);
  }

  reveal(i) {
    const { element, height } = this;
    const wanted = i * height - element.clientHeight / 2;
    if (Math.abs(element.scrollTop - wanted) > height) element.scrollTop = wanted;
    this.draw();
  }
}
