// The page: one moment in time that everything shows, and the keys, addresses and buttons that move it.
import { AmbientLight, DirectionalLight, HemisphereLight, Plane, Raycaster, Scene, Vector2, Vector3, WebGLRenderer } from 'three';
import 'uplot/dist/uPlot.min.css';
import './style.css';
import { Cameras, CAMERAS } from './cameras.js';
import { colourOf, THEMES } from './colours.js';
import { before, load } from './data.js';
import { $, make, number, visible } from './dom.js';
import { toNed } from './frames.js';
import { Ground } from './ground.js';
import { Labels } from './labels.js';
import { findingsPane, linksPane, Log, runPane } from './panels.js';
import { ParametersPane } from './parameters.js';
import { Plots, said } from './plots.js';
import { Traces } from './traces.js';
import { Vehicles } from './vehicles.js';

const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100];
const TRAILS = { none: 0, short: 8, long: 40, all: Infinity };
const SHOWN = [
  ['labels', 'names', 'n'], ['trails', 'trails', 't'], ['packets', 'packets', 'p'], ['desired', 'desired positions', 'g'],
  ['drops', 'height lines', 'h'], ['range', 'radio range', 'r'], ['grid', 'distances on the grid', 'm'],
];
const KEYS = [
  ['space', 'play, pause'], ['.', 'one communication interval (of a run that goes on)'], ['← →', 'one picture back, forward; with shift 1 s'], ['home end', 'begin, end'], ['[ ]', 'slower, faster'],
  ['1 2 3', 'camera: free, follow, top'], ['c', 'next camera'], ['f', 'all vehicles in sight'], ['tab', 'next vehicle (shift: the one before)'], ['esc', 'no vehicle'],
  ['n t p g h r m', 'names, trails, packets, desired positions, height lines, radio range, distances'], ['s', 'vehicles in their true size'], ['y', 'trails: short, long, all'], ['o', 'send the vehicle to the next place clicked (of a run that goes on)'], ['x', 'packets: to the next one sent'],
  ['/', 'find a signal to plot'], ['l', 'message log, filter'], ['j k', 'finding before, after'], ['d', 'dark, light'], ['+ −', 'larger, smaller text'], ['b', 'side panel'], ['v', 'what is drawn'], ['?', 'this help'],
];

class Viewer {
  constructor(run) {
    this.run = run;
    this.t = this.start = run.start;
    this.end = Math.max(run.end, run.start);
    this.playing = false;
    this.live = run.live ?? null; // until the run ends, play, pause, step and speed are those of the run
    this.following = Boolean(this.live);
    this.speed = 1;
    this.selected = -1;
    this.hovered = -1;
    this.theme = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
    this.show = Object.fromEntries(SHOWN.map(([name]) => [name, true]));
    this.show.range = false;
    this.names = run.vehicles.map((vehicle) => visible(vehicle.name));
    this.trail = run.vehicles.length > 60 ? 'short' : 'long';
    this.dirty = true;
    this.costs = [];
    this.#scene();
    this.#panels();
    this.#controls();
    this.#keys();
    this.#pointer();
    this.paint();
    this.fit();
    this.read(location.hash);
    addEventListener('hashchange', () => this.read(location.hash));
    if (this.live) this.#goAlong();
    requestAnimationFrame((now) => this.#frame(now));
  }

  // -- the scene --------------------------------------------------------------------------------------------------

  #scene() {
    const canvas = $('scene');
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: 'high-performance' });
    this.scene = new Scene();
    this.ground = new Ground();
    this.vehicles = new Vehicles(this.run);
    this.traces = new Traces(this.run, this.vehicles);
    this.lights = [new HemisphereLight(0xffffff, 0x445566, 2), new DirectionalLight(0xffffff, 2)];
    this.lights[1].position.set(-0.6, 1, 0.5);
    this.scene.add(this.ground.group, this.vehicles.group, ...this.traces.meshes, ...this.lights, new AmbientLight(0xffffff, 0.25));
    this.cameras = new Cameras(canvas, () => this.touch());
    this.labels = new Labels($('overlay'));
    new ResizeObserver(() => this.#resize()).observe($('stage'));
    this.#resize();
    if (!this.vehicles.n) {
      $('empty').hidden = false;
      $('empty').textContent = 'No positions were recorded: nothing moves here. Signals, messages and findings are on the right.';
    }
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = $('stage');
    if (!width || !height) return;
    const ratio = Math.min(devicePixelRatio || 1, this.vehicles.n > 300 ? 1.5 : 2);
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.labels.resize(width, height, ratio);
    this.cameras.resize(width, height);
    Object.assign(this, { width, height });
    this.touch();
  }

  /** See that the next picture is drawn. */
  touch() {
    this.dirty = true;
  }

  paint() {
    document.documentElement.dataset.theme = this.theme;
    const theme = THEMES[this.theme];
    this.colours = this.run.vehicles.map((_, i) => colourOf(i, this.vehicles.n, this.theme));
    this.ground.paint(theme);
    this.vehicles.paint(this.colours, theme);
    this.traces.paint(this.colours, theme);
    this.lights.forEach((light, i) => (light.intensity = theme.lights[i]));
    $('theme').textContent = this.theme === 'dark' ? '☀' : '☾';
    this.#legend();
    this.plots.repaint();
    this.touch();
  }

  /** All vehicles in sight, wherever they fly. */
  fit() {
    const min = new Vector3(Infinity, 0, Infinity);
    const max = new Vector3(-Infinity, 0, -Infinity);
    const count = this.run.motion.time.length;
    const { stride } = this.run.motion;
    const every = Math.max(1, Math.floor((count * this.vehicles.n) / 200_000));
    for (const { position: p } of this.run.vehicles)
      for (let f = 0; f < count; f += every) {
        const point = new Vector3(p[stride + f], -p[2 * stride + f], -p[f]);
        if (!Number.isFinite(point.x + point.y + point.z)) continue;
        min.min(point);
        max.max(point);
      }
    if (!Number.isFinite(min.x)) {
      min.set(-10, 0, -10);
      max.set(10, 5, 10);
    }
    this.fitted = { min: min.clone(), max: max.clone() };
    this.scale = Math.max(max.x - min.x, max.z - min.z, 5);
    if (this.cameras.kind === 'follow') this.camera('free');
    this.cameras.fit(min, max);
    this.touch();
  }

  #draw() {
    const begun = performance.now();
    const { cameras, vehicles, traces, ground } = this;
    vehicles.update(this.t, cameras.camera, this.height);
    if (cameras.followed >= 0) {
      cameras.follow(vehicles.place(cameras.followed));
      vehicles.update(this.t, cameras.camera, this.height);
    }
    cameras.planes();
    const { camera } = cameras;
    const theme = THEMES[this.theme];
    const going = this.isLive && this.following && !this.live.paused;
    traces.update(this.t, {
      show: this.show, speed: this.isLive ? Math.min(20, this.live.factor ?? 1) : this.speed, playing: this.playing || going, selected: this.selected, scale: this.scale,
      trail: TRAILS[this.trail] === Infinity ? 0 : TRAILS[this.trail], size: [this.width, this.height],
    });
    ground.update(camera, cameras.target, cameras.distance);
    this.renderer.render(this.scene, camera);
    this.labels.update({ camera, target: cameras.target, vehicles, names: this.names, colours: this.colours, theme, show: this.show, selected: this.selected, hovered: this.hovered, ground, distance: cameras.distance });
    const forward = new Vector3();
    camera.getWorldDirection(forward);
    const heading = cameras.kind === 'top' ? 0 : Math.atan2(forward.x, -forward.z);
    $('needle').setAttribute('transform', `rotate(${(-heading * 180) / Math.PI})`);
    this.costs.push(performance.now() - begun);
    if (this.costs.length > 120) this.costs.shift();
  }

  #frame(now) {
    const passed = Math.min(0.25, (now - (this.last ?? now)) / 1000);
    this.last = now;
    if (this.playing) {
      this.t = Math.min(this.end, this.t + passed * this.speed);
      if (this.t >= this.end) this.pause();
      this.dirty = true;
    }
    if (this.dirty) {
      this.dirty = false;
      this.#draw();
      this.#tell();
    }
    requestAnimationFrame((next) => this.#frame(next));
  }

  // -- time -------------------------------------------------------------------------------------------------------

  seek(t) {
    this.following = this.isLive && t >= this.end;
    this.t = Math.min(this.end, Math.max(this.start, t));
    this.touch();
    this.#remember();
  }

  play() {
    if (this.isLive) return this.live.ask('resume');
    if (this.t >= this.end) this.t = this.start;
    this.following = false;
    this.playing = true;
    $('play').textContent = '❚❚';
    this.touch();
  }

  pause() {
    this.playing = this.following = false;
    if (!this.isLive) $('play').textContent = '▶';
    this.touch();
    this.#remember();
  }

  setSpeed(speed) {
    if (this.isLive) return this.live.ask('speed', { factor: speed });
    this.speed = speed;
    this.#tellSpeed(speed);
    this.touch();
  }

  #tellSpeed(speed) {
    const value = speed === null ? '' : String(speed);
    const option = [...$('speed').options].find((one) => one.value === value);
    if (!option) $('speed').append(make('option', { value }, speed === null ? 'max' : `${number(speed)} ×`));
    $('speed').value = value;
  }

  // -- a run that goes on -----------------------------------------------------------------------------------------

  /** True until the run ends. */
  get isLive() {
    return this.live !== null && !this.live.over && this.live.ended === null;
  }

  #goAlong() {
    const { live } = this;
    live.onframe = () => this.#grown();
    live.onstate = () => this.#state();
    live.onlinks = () => this.links.refresh();
    live.onverdict = () => this.#judged();
    live.onparameters = (found) => this.values.show(found);
    live.onrefusal = (reason) => this.values.refuse(reason);
    $('step').addEventListener('click', () => this.step());
    $('now').addEventListener('click', () => this.seek(this.end));
    $('speed').append(make('option', { value: '' }, 'max'));
    $('speed').title = 'speed of the run, times real time ([ and ])';
    $('play').title = 'pause the run, let it go on (space)';
    for (const name of ['pointerdown', 'wheel']) $('scene').addEventListener(name, () => (this.aimed = true));
    this.#grown();
    this.#state();
  }

  /** Values have come in. */
  #grown() {
    const { end, start } = this.run;
    Object.assign(this, { end, start });
    Object.assign($('slider'), { min: String(start), max: String(end) });
    if (this.following) this.t = end;
    this.traces.extend();
    const refresh = () => {
      this.plotted = performance.now();
      if (this.marked !== end && $('marks').children.length) this.#marks();
      this.plots.refresh();
      this.log.grow();
      this.touch();
    };
    if (!(performance.now() - this.plotted < 250)) {
      refresh();
      this.#room();
      this.#outcome();
    } else if (!this.waiting) {
      this.waiting = setTimeout(() => { this.waiting = null; refresh(); }, 250);
    }
    this.touch();
  }

  /** As long as nobody has turned the camera, it keeps all vehicles in sight. */
  #room() {
    if (this.aimed || this.cameras.kind === 'follow' || !this.vehicles.n) return;
    const { min, max } = this.fitted;
    const over = Math.max(2, 0.08 * this.scale);
    const count = this.run.motion.time.length;
    const { stride } = this.run.motion;
    const outside = this.run.vehicles.some(({ position: p }) => {
      const [x, y, z] = [p[stride + count - 1], -p[2 * stride + count - 1], -p[count - 1]];
      return x < min.x - over || x > max.x + over || z < min.z - over || z > max.z + over || y > max.y + over;
    });
    if (outside) this.fit();
  }

  /** The run is paused, goes on, has another speed, or has ended. */
  #state() {
    const going = this.isLive;
    this.values.tell(this.live.changes);
    if (!going) this.aim(false);
    $('step').hidden = $('now').hidden = !going;
    if (going) {
      $('play').textContent = this.live.paused ? '▶' : '❚❚';
      this.#tellSpeed(this.live.speed);
    } else if (!this.parted) {
      this.parted = true;
      $('play').textContent = '▶';
      $('play').title = 'play or pause (space)';
      $('speed').title = 'playback speed ([ and ])';
      [...$('speed').options].find((one) => one.value === '')?.remove();
      this.setSpeed(1);
      this.plots.refresh();
      const more = this.live.ended?.[2];
      if (more) this.tabs.run[1].pane.firstElementChild.append(make('dt', {}, 'all of it'), make('dd', {}, visible(more)));
    }
    this.#outcome();
    this.touch();
  }

  /** There are other findings than before. */
  #judged() {
    this.tabs.findings[1].refresh();
    this.#count();
    this.#marks();
  }

  #outcome() {
    const { live } = this;
    const [words, kind] = live.ended ?? (live.over ? ['the connection to the run is lost', 'warning'] : live.paused ? ['paused', 'warning'] : ['live', 'good']);
    const factor = this.isLive && !live.paused ? live.factor : null;
    $('outcome').textContent = visible(factor === null ? words : `${words}, ${number(factor, 2)} × real time`);
    $('outcome').className = kind;
  }

  /** One communication interval of the run, after which it stands still. */
  step() {
    if (!this.isLive) return;
    this.following = true;
    this.live.ask('step');
  }

  /** Space and the button: of the run while it goes on, else of what is played. */
  playOrPause() {
    if (!this.isLive) return this.playing ? this.pause() : this.play();
    this.following = true;
    this.live.ask(this.live.paused ? 'resume' : 'pause');
  }

  /** Everything beside the scene that goes with time. */
  #tell() {
    const digits = this.end - this.start < 10 ? 3 : 2;
    $('clock').replaceChildren(this.t.toFixed(digits), make('small', {}, ` / ${this.isLive ? this.end.toFixed(1) : number(this.end)} s`));
    $('now').setAttribute('aria-pressed', String(this.following));
    if (document.activeElement !== $('slider') || this.playing || this.following) $('slider').value = String(this.t);
    this.plots.update(this.t);
    this.log.update(this.t);
    this.#card();
  }

  // -- vehicles and cameras ---------------------------------------------------------------------------------------

  select(i) {
    if (i === undefined || i === null) return;
    this.selected = i >= 0 && i < this.vehicles.n ? i : -1;
    if (this.aiming) this.aim(this.selected >= 0);
    if (this.cameras.kind === 'follow') this.camera(this.selected < 0 ? 'free' : 'follow');
    this.#legend();
    if (this.isLive && !this.tabs.values[1].pane.hidden) this.values.find(this.selected < 0 ? '' : this.run.vehicles[this.selected].name);
    this.touch();
    this.#remember();
  }

  camera(kind) {
    if (!this.vehicles.n && kind === 'follow') return;
    if (kind === 'follow' && this.selected < 0) {
      this.selected = 0;
      this.#legend();
    }
    this.vehicles.update(this.t, this.cameras.camera, this.height);
    this.cameras.use(kind, this.selected, kind === 'follow' ? this.vehicles.place(this.selected) : null);
    for (const button of $('cameras').children) button.setAttribute('aria-pressed', String(button.dataset.kind === kind));
    this.touch();
    this.#remember();
  }

  #pick(event) {
    const box = $('scene').getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let [best, nearest] = [-1, 24];
    const point = new Vector3();
    for (let i = 0; i < this.vehicles.n; i++) {
      const at = this.labels.project(this.vehicles.place(i, point), this.cameras.camera);
      const far = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (far < nearest) [best, nearest] = [i, far];
    }
    return best;
  }

  #pointer() {
    const canvas = $('scene');
    let pressed = null;
    canvas.addEventListener('pointerdown', (event) => (pressed = [event.clientX, event.clientY]));
    canvas.addEventListener('pointerup', (event) => {
      const clicked = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
      if (clicked && this.aiming) this.#sendTo(event);
      else if (clicked) this.select(this.#pick(event));
      pressed = null;
    });
    canvas.addEventListener('dblclick', (event) => {
      const i = this.#pick(event);
      if (i >= 0) {
        this.select(i);
        this.camera('follow');
      }
    });
    canvas.addEventListener('pointermove', (event) => {
      if (event.buttons) return;
      const i = this.#pick(event);
      if (i !== this.hovered) {
        this.hovered = i;
        this.touch();
      }
    });
  }

  /** Wait for a click on the ground, which is where the selected vehicle is to fly. */
  aim(on = !this.aiming) {
    this.aiming = on && this.isLive && this.selected >= 0;
    this.sender.setAttribute('aria-pressed', String(Boolean(this.aiming)));
    $('scene').style.cursor = this.aiming ? 'crosshair' : '';
  }

  /** The vehicle keeps its height. */
  #sendTo(event) {
    const box = $('scene').getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.cameras.camera);
    const place = ray.ray.intersectPlane(new Plane(new Vector3(0, 1, 0), 0), new Vector3());
    if (!place) return;
    const [north, east] = toNed(place);
    this.send(this.selected, north, east);
    this.aim(false);
  }

  send(i, north, east, down) {
    const { position } = this.run.vehicles[i];
    const now = this.run.motion.time.length - 1;
    this.live.ask('send', { vehicle: this.run.vehicles[i].name, place: [north, east, down ?? position[2 * this.run.motion.stride + now]] });
  }

  #legend() {
    const n = this.vehicles.n;
    const shown = n <= 24 ? [...Array(n).keys()] : [];
    const buttons = shown.map((i) => {
      const button = make('button', { onclick: () => this.select(this.selected === i ? -1 : i) }, make('i', { style: { background: this.colours[i] } }), this.names[i]);
      button.setAttribute('aria-pressed', String(i === this.selected));
      return button;
    });
    if (n > 24) {
      const pick = make('input', { type: 'search', placeholder: `find one of ${n} vehicles`, style: { width: '240px' } });
      pick.addEventListener('keydown', (event) => event.stopPropagation());
      pick.addEventListener('change', () => {
        const text = pick.value.toLowerCase();
        const exact = this.names.findIndex((name) => name.toLowerCase() === text);
        const found = exact >= 0 ? exact : this.names.findIndex((name) => name.toLowerCase().includes(text));
        if (text && found >= 0) this.select(found);
      });
      buttons.push(pick);
    }
    $('legend').replaceChildren(...buttons);
    this.cardOf = null;
  }

  /** The vehicle selected: where it is, how fast, and what its FMUs say in words. */
  #card() {
    const card = $('card');
    card.hidden = this.selected < 0;
    if (card.hidden) return;
    const vehicle = this.run.vehicles[this.selected];
    const at = this.vehicles.at(this.t);
    const time = this.run.motion.time;
    const { stride } = this.run.motion;
    const ned = Vehicles.between(vehicle.position, stride, at, [0, 0, 0]);
    const [i, j] = at[0] < at[1] ? at : [Math.max(0, at[0] - 1), at[0]];
    const dt = time[j] - time[i];
    const speed = dt > 0 ? Math.hypot(...[0, 1, 2].map((k) => vehicle.position[k * stride + j] - vehicle.position[k * stride + i])) / dt : 0;
    const facts = [['north, east', `${ned[0].toFixed(2)}, ${ned[1].toFixed(2)} m`], ['height', `${(-ned[2]).toFixed(2)} m`], ['speed', `${speed.toFixed(2)} m/s`]];
    for (const index of vehicle.words) {
      const signal = this.run.signals[index];
      facts.push([signal.name.slice(signal.name.indexOf('.', vehicle.name.length) + 1 || 0), said(signal, this.run.valueAt(index, this.t))]);
    }
    this.sender.hidden = this.said.hidden = !this.isLive;
    this.said.textContent = visible(this.live?.said[1] ?? '');
    this.facts.replaceChildren(
      make('h2', {}, make('i', { style: { background: this.colours[this.selected] } }), this.names[this.selected]),
      make('table', {}, ...facts.map(([term, text]) => make('tr', {}, make('td', {}, visible(term)), make('td', {}, visible(text))))),
    );
  }

  // -- panels, buttons, keys --------------------------------------------------------------------------------------

  #panels() {
    const { run } = this;
    const goTo = { seek: (t) => { this.pause(); this.seek(t); }, select: (i) => i !== undefined && i !== null && i >= 0 && this.select(i) };
    const colourOfSignal = (index) => {
      const vehicle = run.signals[index].vehicle;
      return vehicle === undefined || this.vehicles.n > 8 ? null : this.colours[vehicle];
    };
    this.facts = make('div');
    this.said = make('p', { class: 'said' });
    this.sender = make('button', { id: 'send', title: 'then click on the ground (o); the vehicle keeps its height', onpointerdown: () => this.aim() }, 'Send to a place');
    $('card').append(this.facts, this.sender, this.said);
    this.colours = run.vehicles.map((_, i) => colourOf(i, run.vehicles.length, this.theme));
    document.documentElement.dataset.theme = this.theme;
    this.plots = new Plots(run, { seek: goTo.seek, colourOfSignal });
    this.log = new Log(run, goTo);
    this.links = linksPane(run, goTo.select);
    this.tabs = {
      plots: ['Plots', this.plots],
      log: ['Messages', this.log],
      links: ['Links', this.links],
      ...(run.live ? { values: ['Values', (this.values = new ParametersPane(run.live))] } : {}),
      findings: ['Findings', findingsPane(run, goTo)],
      run: ['Run', runPane(run)],
    };
    for (const [name, [title, { pane }]] of Object.entries(this.tabs)) {
      const button = make('button', { onclick: () => this.tab(name), role: 'tab', data: { name } }, title);
      $('tabs').append(button);
      $('panes').append(pane);
    }
    this.#count();
    this.plots.sets = run.plots.map((set) => set.slice());
    this.tab('plots');
    $('system').textContent = visible(run.name);
    const [outcome, kind] = run.outcome;
    $('outcome').textContent = visible(outcome);
    $('outcome').className = kind;
  }

  /** The number of findings, on their tab. */
  #count() {
    const { verdict } = this.run;
    const button = [...$('tabs').children].find((one) => one.dataset.name === 'findings');
    button.querySelector('sup')?.remove();
    if (verdict?.findings.length) button.append(make('sup', {}, String(verdict.findings.length)));
    button.className = !verdict ? '' : verdict.failures ? 'failure' : verdict.warnings ? 'warning' : '';
  }

  tab(name) {
    if (!(name in this.tabs)) return;
    for (const [other, [, { pane }]] of Object.entries(this.tabs)) pane.hidden = other !== name;
    for (const button of $('tabs').children) button.setAttribute('aria-selected', String(button.dataset.name === name));
    this.plots.update(this.t);
    if (name === 'log') this.log.update(this.t, true);
    if (name === 'values' && this.isLive) this.values.find(this.values.input.value);
    if (name === 'plots' && this.plots.plots.length === 0 && this.plots.sets.length) this.plots.draw();
  }

  #controls() {
    const slider = $('slider');
    Object.assign(slider, { min: String(this.start), max: String(this.end), value: String(this.t) });
    slider.addEventListener('input', () => this.seek(Number(slider.value)));
    slider.addEventListener('change', () => slider.blur());
    $('play').textContent = '▶';
    $('play').addEventListener('click', () => { this.playOrPause(); $('play').blur(); });
    $('speed').append(...SPEEDS.map((speed) => make('option', { value: String(speed) }, `${speed} ×`)));
    $('speed').value = '1';
    $('speed').addEventListener('change', () => { this.setSpeed($('speed').value === '' ? null : Number($('speed').value)); $('speed').blur(); });
    for (const kind of CAMERAS) $('cameras').append(make('button', { onclick: () => this.camera(kind), data: { kind }, 'aria-pressed': String(kind === 'free') }, kind));
    $('theme').addEventListener('click', () => this.setTheme(this.theme === 'dark' ? 'light' : 'dark'));
    $('help').addEventListener('click', () => this.help());
    this.#menu();
    this.#marks();
    this.#grip();
    $('keys').append(make('h2', {}, 'Keys'), make('table', {}, ...KEYS.map(([keys, text]) => make('tr', {}, make('td', {}, ...keys.split(' ').map((key) => make('kbd', {}, key))), make('td', {}, text)))));
    $('keys').addEventListener('click', () => $('keys').close());
  }

  #menu() {
    for (const [name, text, key] of SHOWN) {
      const box = make('input', { type: 'checkbox', checked: this.show[name], id: `show-${name}` });
      box.addEventListener('change', () => this.toggle(name, box.checked));
      $('menu').append(make('label', {}, box, text, make('kbd', {}, key)));
    }
    const size = make('input', { type: 'checkbox', id: 'show-size' });
    size.addEventListener('change', () => this.trueSize(size.checked));
    $('menu').append(make('label', {}, size, 'vehicles in their true size', make('kbd', {}, 's')));
    const trail = make('select', { id: 'trail' }, ...Object.keys(TRAILS).map((name) => make('option', { value: name }, name === 'none' ? 'none' : name === 'all' ? 'since the begin' : `${TRAILS[name]} s`)));
    trail.value = this.trail;
    trail.addEventListener('change', () => this.setTrail(trail.value));
    $('menu').append(make('label', {}, 'trails ', trail, make('kbd', {}, 'y')));
    $('switches').addEventListener('click', () => ($('menu').hidden = !$('menu').hidden));
    addEventListener('pointerdown', (event) => !event.target.closest('#menu, #switches') && ($('menu').hidden = true));
  }

  setTrail(name) {
    this.trail = name;
    $('trail').value = name;
    this.show.trails = name !== 'none';
    $('show-trails').checked = this.show.trails;
    this.touch();
  }

  toggle(name, on = !this.show[name]) {
    this.show[name] = on;
    $(`show-${name}`).checked = on;
    if (name === 'trails' && on && this.trail === 'none') this.setTrail('long');
    this.touch();
  }

  trueSize(on) {
    this.vehicles.trueSize = on;
    $('show-size').checked = on;
    this.touch();
  }

  #marks() {
    const { run, start, end } = this;
    const left = (t) => `${(100 * (t - start)) / Math.max(end - start, 1e-9)}%`;
    this.marked = end;
    $('marks').replaceChildren();
    const steps = run.steps.length <= 40 ? run.steps : [];
    const numbered = steps.length <= 20;
    for (const [n, t] of steps) $('marks').append(make('i', { class: 'step', style: { left: left(t) }, title: `step #${n} begins at ${number(t)} s`, data: numbered ? { n: String(n) } : {}, onclick: () => this.seek(t) }));
    for (const finding of run.verdict?.findings.slice(0, 400).reverse() ?? []) {
      if (finding.time === null) continue;
      const go = () => {
        this.pause();
        this.seek(finding.time);
        this.select(finding.vehicle);
        this.tab('findings');
      };
      $('marks').append(make('i', { class: `finding ${finding.severity}`, style: { left: left(finding.time) }, title: visible(`${number(finding.time)} s: ${finding.kind}: ${finding.text}`), onclick: go }));
    }
  }

  #grip() {
    const set = (width) => {
      document.documentElement.style.setProperty('--side', `${Math.round(Math.max(240, Math.min(innerWidth * 0.7, width)))}px`);
    };
    $('grip').addEventListener('pointerdown', (event) => {
      $('grip').setPointerCapture(event.pointerId);
      $('grip').onpointermove = (move) => set(innerWidth - move.clientX);
      $('grip').onpointerup = () => ($('grip').onpointermove = null);
    });
    set(Math.max(360, Math.min(560, innerWidth * 0.31)));
    if (!this.vehicles.n) set(innerWidth * 0.7);
  }

  help() {
    if ($('keys').open) $('keys').close();
    else $('keys').showModal();
  }

  setTheme(theme) {
    this.theme = theme;
    this.paint();
    this.#remember();
  }

  #keys() {
    let size = 14;
    const text = (by) => {
      size = Math.max(11, Math.min(24, size + by));
      document.documentElement.style.fontSize = `${size}px`;
    };
    const step = (by, shift) => {
      this.pause();
      const { time } = this.run.motion;
      const rows = time.length ? time : this.run.rows;
      const i = before(rows, this.t + 1e-9);
      this.seek(shift ? this.t + by : rows[Math.max(0, Math.min(rows.length - 1, by < 0 && rows[i] < this.t - 1e-9 ? i : i + by))]);
    };
    const faster = (by) => {
      const speeds = this.isLive ? this.live.speed ?? Infinity : this.speed;
      const i = SPEEDS.findIndex((speed) => speed >= speeds);
      this.setSpeed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, (i < 0 ? SPEEDS.length - 1 : i) + by))]);
    };
    const findings = (by) => {
      const at = (this.run.verdict?.findings ?? []).filter((one) => one.time !== null).sort((a, b) => a.time - b.time);
      const next = by > 0 ? at.find((one) => one.time > this.t + 1e-6) : at.findLast((one) => one.time < this.t - 1e-6);
      if (!next) return;
      this.pause();
      this.seek(next.time);
      this.select(next.vehicle);
    };
    const nextPacket = () => {
      const sent = this.run.traffic.flights?.sent;
      if (!sent?.length) return;
      this.pause();
      const i = before(sent, this.t + 1e-9);
      this.seek(sent[sent[i] > this.t + 1e-9 ? i : Math.min(i + 1, sent.length - 1)] + 1e-6);
    };
    const other = (by) => this.vehicles.n && this.select((this.selected + by + (this.selected < 0 && by < 0 ? 1 : 0) + this.vehicles.n) % this.vehicles.n);
    const actions = {
      ' ': () => this.playOrPause(), '.': () => this.step(),
      ArrowLeft: (event) => step(-1, event.shiftKey), ArrowRight: (event) => step(1, event.shiftKey),
      Home: () => this.seek(this.start), End: () => this.seek(this.end),
      '[': () => faster(-1), ']': () => faster(1),
      1: () => this.camera('free'), 2: () => this.camera('follow'), 3: () => this.camera('top'),
      c: () => this.camera(CAMERAS[(CAMERAS.indexOf(this.cameras.kind) + 1) % CAMERAS.length]),
      f: () => this.fit(),
      Tab: (event) => other(event.shiftKey ? -1 : 1), Escape: () => (this.aiming ? this.aim(false) : $('menu').hidden ? this.select(-1) : ($('menu').hidden = true)), o: () => this.aim(),
      s: () => this.trueSize(!this.vehicles.trueSize),
      y: () => this.setTrail({ none: 'short', short: 'long', long: 'all', all: 'short' }[this.trail]),
      x: nextPacket,
      '/': () => { this.tab('plots'); $('find').focus(); },
      l: () => { this.tab('log'); $('filter')?.focus(); },
      j: () => findings(-1), k: () => findings(1),
      d: () => this.setTheme(this.theme === 'dark' ? 'light' : 'dark'),
      '+': () => text(1), '=': () => text(1), '-': () => text(-1),
      b: () => { $('side').hidden = !$('side').hidden; document.documentElement.style.setProperty('--side', $('side').hidden ? '0px' : '400px'); },
      v: () => ($('menu').hidden = !$('menu').hidden),
      '?': () => this.help(),
      ...Object.fromEntries(SHOWN.map(([name, , key]) => [key, () => this.toggle(name)])),
    };
    addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || /^(INPUT|SELECT)$/.test(event.target.tagName) && event.target.type !== 'range' && event.target.type !== 'checkbox') return;
      if ($('keys').open && event.key !== '?') return;
      const action = actions[event.key];
      if (!action) return;
      event.preventDefault();
      action(event);
    });
  }

  // -- the address ------------------------------------------------------------------------------------------------

  /** Take over what an address asks for: #t=28&camera=top&select=drone3&theme=light&speed=0.1&play&tab=log */
  read(hash) {
    const asked = new URLSearchParams(hash.replace(/^#/, ''));
    if (['light', 'dark'].includes(asked.get('theme')) && asked.get('theme') !== this.theme) {
      this.theme = asked.get('theme');
      this.paint();
    }
    const numeric = (name) => (asked.has(name) && Number.isFinite(Number(asked.get(name))) && asked.get(name) !== '' ? Number(asked.get(name)) : null);
    if (numeric('t') !== null && !this.following) this.t = Math.min(this.end, Math.max(this.start, numeric('t')));
    if (numeric('speed') > 0 && !this.isLive) this.setSpeed(numeric('speed'));
    if (asked.has('select')) this.selected = this.run.vehicles.findIndex((vehicle) => vehicle.name === asked.get('select'));
    if (asked.has('trail') && asked.get('trail') in TRAILS) this.setTrail(asked.get('trail'));
    if (CAMERAS.includes(asked.get('camera'))) this.camera(asked.get('camera'));
    if (asked.get('tab') in this.tabs) this.tab(asked.get('tab'));
    if (asked.has('filter')) this.log.filter(asked.get('filter'));
    if (asked.has('plot')) this.plots.set(asked.getAll('plot').map((text) => this.plots.find(text, 12)).filter((set) => set.length));
    if (asked.has('play') && !this.isLive) this.play();
    this.#legend();
    this.touch();
  }

  /** Keep the address that leads back to what is shown. */
  #remember() {
    if (this.following) return;
    clearTimeout(this.remembering);
    this.remembering = setTimeout(() => {
      const told = new URLSearchParams({ t: String(Math.round(this.t * 1e4) / 1e4), camera: this.cameras.kind, theme: this.theme });
      if (this.selected >= 0) told.set('select', this.run.vehicles[this.selected].name);
      history.replaceState(null, '', `#${told}`);
    }, 300);
  }

  // -- for programs -----------------------------------------------------------------------------------------------

  /** What `window.cosim` offers; docs/view.md describes it. */
  face() {
    const viewer = this;
    const named = (name) => {
      const i = viewer.run.vehicles.findIndex((vehicle) => vehicle.name === name);
      if (i < 0) throw new Error(`there is no vehicle ${name}; there are ${viewer.run.vehicles.slice(0, 10).map((one) => one.name).join(', ')}`);
      return i;
    };
    return {
      get time() { return viewer.t; },
      get playing() { return viewer.playing; },
      get start() { return viewer.start; },
      get end() { return viewer.end; },
      get camera() { return viewer.cameras.kind; },
      get theme() { return viewer.theme; },
      /** The run that goes on: null for a recording. */
      get live() {
        const { live } = viewer;
        return live && { going: viewer.isLive, paused: live.paused, speed: live.speed, ended: live.ended, following: viewer.following, frames: live.n, changes: live.changes, said: live.said[1] };
      },
      step: () => viewer.step(),
      send: (name, north, east, down) => viewer.send(named(name), north, east, down),
      set: (name, value) => viewer.live.ask('set', { name, value: String(value) }),
      setSpeed: (factor) => viewer.setSpeed(factor),
      vehicles: viewer.run.vehicles.map((vehicle) => vehicle.name),
      play: () => viewer.play(),
      pause: () => viewer.pause(),
      seek: (t) => viewer.seek(t),
      look: (kind) => viewer.camera(kind),
      select: (name) => viewer.select(name === null ? -1 : named(name)),
      selected: () => (viewer.selected < 0 ? null : viewer.run.vehicles[viewer.selected].name),
      position: (name) => toNed(viewer.vehicles.place(named(name))),
      screen: (name) => viewer.labels.project(viewer.vehicles.place(named(name)), viewer.cameras.camera),
      rotors: (name) => viewer.run.vehicles[named(name)].rotors?.length ?? null,
      value: (name) => { const index = viewer.run.index.get(name); return said(viewer.run.signals[index], viewer.run.valueAt(index, viewer.t)); },
      plot: (...texts) => viewer.plots.set(texts.map((text) => viewer.plots.find(text, 12))),
      plots: () => viewer.plots.shown(),
      log: (filter) => { if (filter !== undefined) viewer.log.filter(filter); return viewer.log.list(); },
      links: () => viewer.run.traffic.links ?? [],
      findings: () => viewer.run.verdict?.findings ?? [],
      flying: () => ({ ...viewer.traces.flying }),
      /** Resolves once a picture of the present moment has been drawn. */
      drawn: () => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve()))),
      /** Milliseconds from picture to picture while it plays, and of those what this page's own code took. */
      async measure(pictures = 60) {
        viewer.play();
        const between = [];
        let last = await new Promise(requestAnimationFrame);
        viewer.costs.length = 0;
        while (between.length < pictures) {
          const now = await new Promise(requestAnimationFrame);
          between.push(now - last);
          last = now;
        }
        viewer.pause();
        const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];
        return { picture: median(between), script: median(viewer.costs) };
      },
    };
  }
}

async function begin() {
  const viewer = new Viewer(await load());
  window.cosim = viewer.face();
  document.documentElement.dataset.ready = 'true';
}

begin().catch((error) => {
  const text = `This page cannot show the run: ${error.message}. It needs WebGL 2 and a browser of 2023 or later.`;
  document.body.replaceChildren(make('p', { style: { padding: '2em', fontSize: '16px' } }, text));
  throw error;
});
