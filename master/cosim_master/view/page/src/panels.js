// What stands beside the scene besides plots: messages, links, findings, and the run itself.
import { make, number, Rows, visible } from './dom.js';
import { before } from './data.js';

const seconds = (t) => t.toFixed(2);

/** All packets sent, by name, with the texts of those that carry one. */
export class Log {
  constructor(run, { seek, select }) {
    this.run = run;
    const { log, messages, sources } = run.traffic;
    this.log = log;
    this.rows = new Rows((entry) => this.#row(entry), 42);
    this.input = make('input', { type: 'search', id: 'filter', placeholder: 'Filter: STATUSTEXT, drone3, lost, -HEARTBEAT', spellcheck: false, autocomplete: 'off' });
    this.input.addEventListener('input', () => this.filter(this.input.value));
    this.input.addEventListener('keydown', (event) => { event.stopPropagation(); if (event.key === 'Escape') this.input.blur(); });
    this.count = make('div', { class: 'dim' });
    this.pane = make('section', { class: 'pane', id: 'pane-log', hidden: true }, this.input, this.count, this.rows.element);
    this.rows.element.addEventListener('click', (event) => {
      const row = event.target.closest('.row');
      if (!row) return;
      const entry = Number(row.dataset.entry);
      seek(log.time[entry]);
      select(run.traffic.vehicleOf[log.source[entry]]);
    });
    this.now = -1;
    this.dropped = 0;
    this.words = log ? Array.from(log.time, (_, i) => this.#words(i, messages, sources)) : [];
    this.filter('');
  }

  /** Take over the messages that have come in. */
  grow() {
    const { log, run } = this;
    if (!log) return;
    const { dropped } = run.live.radio;
    this.words.splice(0, dropped - this.dropped);
    this.dropped = dropped;
    for (let i = this.words.length; i < log.time.length; i++) this.words.push(this.#words(i, run.traffic.messages, run.traffic.sources));
    this.filter(this.input.value);
  }

  #words(i, messages, sources) {
    const { log } = this;
    const lost = log.lost[i] ? ' lost' : '';
    return `${messages[log.message[i]]} ${sources[log.source[i]]} ${log.texts[i]}${lost}`.toLowerCase();
  }

  /** Show the entries that have all words of a text, and none of those behind a minus. */
  filter(text) {
    this.input.value = text;
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = words.filter((word) => !word.startsWith('-'));
    const unwanted = words.filter((word) => word.startsWith('-') && word.length > 1).map((word) => word.slice(1));
    this.shown = [];
    this.words.forEach((entry, i) => {
      if (wanted.every((word) => entry.includes(word)) && !unwanted.some((word) => entry.includes(word))) this.shown.push(i);
    });
    const { traffic } = this.run;
    const of = this.run.live ? 'since the run began: those since the page is open, of many at once texts and rare kinds first' : 'in the recording: all of the rare kinds, some of the others';
    const thinned = this.log && traffic.log.of > this.words.length ? ` (of ${traffic.log.of} ${of})` : '';
    this.count.textContent = this.log ? `${this.shown.length} of ${this.words.length} packets sent${thinned}` : 'No packets were recorded.';
    this.times = Float64Array.from(this.shown, (i) => this.log.time[i]);
    this.rows.set(this.shown);
    if (this.t !== undefined) this.update(this.t, true);
  }

  #row(entry) {
    const { log, run } = this;
    const { messages, sources } = run.traffic;
    const text = log.texts[entry];
    const lost = log.lost[entry] ? make('span', { class: 'failure' }, `lost to ${log.lost[entry]}`) : null;
    const kind = log.time[entry] > this.t ? ' expected' : entry === this.now ? ' now' : '';
    return make(
      'div',
      { class: `row${kind}${run.traffic.spoken[log.message[entry]] ? ' text' : ''}`, data: { entry: String(entry) }, title: visible(text) },
      make('div', {}, make('span', { class: 't' }, seconds(log.time[entry])), make('b', {}, visible(messages[log.message[entry]])), make('span', {}, visible(sources[log.source[entry]])), lost),
      make('div', { class: 'what' }, visible(text)),
    );
  }

  update(t, always = false) {
    this.t = t;
    if (this.pane.hidden && !always) return;
    if (!this.shown.length) return;
    const i = before(this.times, t);
    this.now = this.times[i] <= t ? this.shown[i] : -1;
    this.rows.reveal(i);
  }

  /** Rows in the filtered log, as text. */
  list() {
    const { log, run } = this;
    return this.shown.map((i) => ({ time: log.time[i], source: run.traffic.sources[log.source[i]], message: run.traffic.messages[log.message[i]], text: log.texts[i], heard: log.heard[i], lost: log.lost[i] }));
  }
}

export function linksPane(run, select) {
  const pane = make('section', { class: 'pane', id: 'pane-links', hidden: true });
  const refresh = () => pane.replaceChildren(...linksOf(run, select));
  refresh();
  return { pane, refresh };
}

function linksOf(run, select) {
  const { links } = run.traffic;
  const { network, packets } = run;
  const facts = [
    ['topology', network.topology], ['latency', `${number(network.latency)} s`], ['jitter', `${number(network.jitter)} s`],
    ['loss', number(network.loss)], ['range', network.range ? `${number(network.range)} m` : 'unlimited'],
    ['packets', `${packets.sent} by radio, ${packets.delivered} delivered, ${packets.lost} lost`],
  ];
  if (!links || !links.length) return [definitions(facts), make('p', { class: 'dim' }, run.traffic.live ? 'No packets yet.' : 'No packets were recorded.')];
  const table = make('table', { class: 'sheet' });
  const heads = ['from', 'to', 'sent', 'lost', 'loss', 'delay', 'per s'];
  table.append(make('thead', {}, make('tr', {}, ...heads.map((h, i) => make('th', { class: i > 1 ? 'number' : '', title: h === 'delay' ? 'mean, ms' : '' }, h === 'delay' ? 'ms' : h)))));
  const body = make('tbody');
  for (const one of links.slice(0, 500)) {
    const row = make('tr', { class: one.lost ? 'lossy' : '', title: Object.entries(one.causes).map(([cause, n]) => `${n} ${cause}`).join(', ') });
    const cells = [one.from, one.to, one.sent, one.lost, `${number((100 * one.lost) / one.sent, 3)} %`, one.delay === null ? '' : number(one.delay * 1e3, 3), number(one.rate, 3)];
    row.append(...cells.map((cell, i) => make('td', { class: `${i > 1 ? 'number' : ''}${i === 3 || i === 4 ? ' lost' : ''}` }, visible(String(cell)))));
    row.addEventListener('click', () => select(one.vehicle));
    body.append(row);
  }
  table.append(body);
  const more = (run.traffic.linksOf ?? links.length) - Math.min(500, links.length);
  return [definitions(facts), table, ...(more > 0 ? [make('p', { class: 'dim' }, `and ${more} more links; the worst ones stand first`)] : [])];
}

export function findingsPane(run, { seek, select }) {
  const pane = make('section', { class: 'pane', id: 'pane-findings', hidden: true });
  const refresh = () => pane.replaceChildren(...findingsOf(run, seek, select));
  refresh();
  return { pane, refresh };
}

function findingsOf(run, seek, select) {
  const { verdict } = run;
  const found = [];
  const say = (text) => found.push(make('p', { class: 'dim' }, text));
  const going = run.live && !run.live.ended;
  if (!verdict && !going) say('The run was not judged.');
  else if (!verdict?.findings.length) say(going ? 'Nothing so far.' : 'Nothing to say: the swarm did what it was to do.');
  for (const finding of verdict?.findings.slice(0, 1000) ?? []) {
    const at = finding.time === null ? 'before the run' : `${seconds(finding.time)} s`;
    const entry = make('div', { class: `finding ${finding.severity}` }, make('b', {}, finding.severity), make('b', {}, visible(finding.kind)), make('time', {}, at), make('div', {}, visible(finding.text)));
    entry.addEventListener('click', () => {
      if (finding.time !== null) seek(finding.time);
      select(finding.vehicle);
    });
    found.push(entry);
  }
  if (verdict?.nearest?.who) {
    const { who, distance, time } = verdict.nearest;
    say(`Nearest: ${visible(who.join(' and '))}, ${number(distance, 4)} m at ${number(time)} s`);
  }
  return found;
}

export function runPane(run) {
  return { pane: make('section', { class: 'pane', id: 'pane-run', hidden: true }, definitions(run.facts)) };
}

const definitions = (facts) => make('dl', { class: 'facts' }, ...facts.flatMap(([term, text]) => [make('dt', {}, visible(String(term))), make('dd', {}, visible(String(text)))]));
