// What is drawn between and behind the vehicles: trails, packets in flight, desired positions, drop lines, range.
import { Color } from 'three';
import { before } from './data.js';
import * as frames from './frames.js';
import { Ribbons } from './ribbons.js';
import { Vehicles } from './vehicles.js';

const SEGMENTS = 120_000;
const DYNAMIC = 12_000;

export class Traces {
  constructor(run, vehicles) {
    this.run = run;
    this.vehicles = vehicles;
    this.trails = this.#trails();
    this.dropped = 0;
    this.lines = new Ribbons(DYNAMIC, { width: 1.4, opacity: 0.55, dynamic: true });
    this.links = new Ribbons(DYNAMIC, { width: 2.4, opacity: 0.95, dynamic: true });
    this.lines.mesh.renderOrder = 1;
    this.links.mesh.renderOrder = 3;
    this.meshes = [this.trails.mesh, this.lines.mesh, this.links.mesh];
    this.flying = { radio: 0, lost: 0 };
  }

  /** All trails in the order of time, so that those of the last seconds lie side by side. */
  #trails() {
    const n = this.vehicles.n;
    this.#stop();
    const room = this.run.live ? SEGMENTS : n * Math.max(0, this.stops.length - 1);
    const trails = new Ribbons(Math.max(1, room), { width: n > 60 ? 1.3 : 2.6, opacity: 0.85 });
    trails.mesh.renderOrder = 2;
    return trails;
  }

  /** Choose the frames that trails go through; while frames are added, half of the room is left for them. */
  #stop() {
    const { time } = this.run.motion;
    const room = this.run.live ? SEGMENTS / 2 : SEGMENTS;
    this.every = Math.max(1, Math.ceil((this.vehicles.n * time.length) / room), Math.ceil(time.length / 6000));
    this.stops = [];
    for (let i = 0; i < time.length; i += this.every) this.stops.push(i);
    if (time.length && this.stops.at(-1) !== time.length - 1) this.stops.push(time.length - 1);
    this.stopTimes = this.stops.map((i) => time[i]);
  }

  /** Add the frames that have come in. */
  extend() {
    const { time } = this.run.motion;
    const { n } = this.vehicles;
    if (!n) return;
    if (this.dropped !== this.run.live.dropped || this.trails.used + n > this.trails.capacity) {
      this.dropped = this.run.live.dropped;
      this.#stop();
      this.#write();
      return;
    }
    const used = this.trails.used;
    for (let i = this.stops.at(-1) + this.every; i < time.length && this.trails.used + n <= this.trails.capacity; i += this.every) {
      this.stops.push(i);
      this.stopTimes.push(time[i]);
      this.#segment(this.stops.length - 2);
    }
    this.trails.upload(used, this.trails.used);
  }

  paint(colours, theme) {
    const rgb = (css) => new Color(css).toArray();
    this.colours = colours.map(rgb);
    this.theme = Object.fromEntries(['link', 'lost', 'desired', 'grid', 'major', 'pulse', 'ground'].map((name) => [name, rgb(theme[name])]));
    this.#write();
  }

  #write() {
    this.trails.clear();
    for (let s = 0; s + 1 < this.stops.length; s++) this.#segment(s);
    this.trails.show(0, this.trails.used, true);
  }

  /** The segments of all vehicles between two stops. */
  #segment(s) {
    const { trails, stops, stopTimes } = this;
    const count = this.run.motion.stride;
    const [i, j] = [stops[s], stops[s + 1]];
    this.run.vehicles.forEach(({ position: p }, v) => {
      trails.add(p[count + i], -p[2 * count + i], -p[i], p[count + j], -p[2 * count + j], -p[j], this.colours[v], stopTimes[s] - stopTimes[0], stopTimes[s + 1] - stopTimes[0]);
    });
  }

  update(t, { show, speed, playing, selected, scale, trail, size }) {
    const n = this.vehicles.n;
    for (const ribbons of [this.trails, this.lines, this.links]) ribbons.material.uniforms.size.value.set(...size);
    this.trails.material.uniforms.now.value = t - this.stopTimes[0];
    this.trails.material.uniforms.fade.value = trail;
    const from = Number.isFinite(trail) && trail > 0 ? before(this.stopTimes, t - trail) : 0;
    const last = Math.min(before(this.stopTimes, t) + 1, this.stops.length - 1);
    this.trails.show(show.trails ? from * n : 0, show.trails ? last * n : 0, false);
    this.lines.clear();
    if (show.drops) this.#drops(n);
    if (show.desired) this.#desired(t);
    if (show.range) this.#range(selected);
    this.lines.show(0, this.lines.used, true);
    this.links.clear();
    this.flying = { radio: 0, lost: 0 };
    if (show.packets && this.run.traffic.flights) this.#packets(t, speed, playing, scale);
    this.links.material.uniforms.width.value = this.many ? 1.4 : 2.4;
    this.links.show(0, this.links.used, true);
  }

  #drops(n) {
    const { places } = this.vehicles;
    if (n > 400) return;
    for (let i = 0; i < n; i++) {
      const [px, py, pz] = places.subarray(3 * i, 3 * i + 3);
      if (py > 0.3) this.lines.add(px, 0.02, pz, px, py, pz, this.theme.major);
    }
  }

  #desired(t) {
    const at = this.vehicles.at(t);
    const count = this.run.motion.stride;
    const ned = [0, 0, 0];
    this.run.vehicles.forEach((vehicle, i) => {
      const [px, py, pz] = this.vehicles.places.subarray(3 * i, 3 * i + 3);
      const colour = this.colours[i];
      const size = Math.max(0.35, this.vehicles.scales[i] * 0.55);
      if (vehicle.desired) {
        Vehicles.between(vehicle.desired, count, at, ned);
        const [x, y, z] = [frames.x(ned), frames.y(ned), frames.z(ned)];
        if (Math.hypot(x - px, y - py, z - pz) > 1.2 * size) {
          this.#cross(x, y, z, size, this.theme.desired);
          this.lines.add(px, py, pz, x, y, z, this.theme.desired);
        }
      }
      const goal = vehicle.goal && vehicle.goal[at[0]];
      if (vehicle.goal && Number.isFinite(goal)) this.#pin(goal, Math.max(py, 0), pz, size, colour, Math.abs(goal - px) > 1.5 * size);
    });
  }

  #cross(x, y, z, s, colour) {
    this.lines.add(x - s, y, z, x + s, y, z, colour);
    this.lines.add(x, y, z - s, x, y, z + s, colour);
    this.lines.add(x, y - s, z, x, y + s, z, colour);
  }

  /** Where on its line an agent wants its vehicle: a ring on the ground, and a diamond at the vehicle's height. */
  #pin(x, y, z, s, colour, away) {
    this.#ring(x, 0.03, z, s, colour, 24);
    if (!away) return;
    this.lines.add(x, 0.03, z, x, y - s, z, colour);
    this.lines.add(x - s, y, z, x, y + s, z, colour);
    this.lines.add(x, y + s, z, x + s, y, z, colour);
    this.lines.add(x + s, y, z, x, y - s, z, colour);
    this.lines.add(x, y - s, z, x - s, y, z, colour);
  }

  #ring(x, y, z, r, colour, parts) {
    for (let k = 0; k < parts; k++) {
      const [a, b] = [(2 * Math.PI * k) / parts, (2 * Math.PI * (k + 1)) / parts];
      this.lines.add(x + r * Math.cos(a), y, z + r * Math.sin(a), x + r * Math.cos(b), y, z + r * Math.sin(b), colour);
    }
  }

  #range(selected) {
    const { range } = this.run.network;
    if (!range) return;
    const n = this.vehicles.n;
    for (let i = 0; i < n; i++) {
      if (selected >= 0 ? i !== selected : n > 20) continue;
      const [px, py, pz] = this.vehicles.places.subarray(3 * i, 3 * i + 3);
      this.#ring(px, py, pz, range, this.colours[i], 72);
    }
  }

  /** Packets between being sent and a moment after they arrive; those lost go half of the way and are red. */
  #packets(t, speed, playing, scale) {
    const { flights, longest } = this.run.traffic;
    const glow = Math.max(0.12, 0.3 * speed) * (playing ? 1 : 0.7);
    const first = before(flights.sent, t - longest - 2 * glow);
    const { places } = this.vehicles;
    let many = 0;
    for (let p = first; p < flights.sent.length && flights.sent[p] <= t; p++) many++;
    const plain = many > 150;
    this.many = plain;
    for (let k = 0; k < 2 * many; k++) {
      const p = first + (k % many);
      const lost = flights.lost[p] > 0;
      if (lost !== k >= many) continue; // those lost lie above the others
      const since = t - flights.sent[p];
      const over = since - (lost ? 0 : flights.delay[p]);
      const fade = over <= 0 ? 1 : 1 - over / (lost ? 2 * glow : glow);
      const [from, to] = [flights.from[p], flights.to[p]];
      if (fade <= 0 || from === 65535 || to === 65535 || from === to) continue;
      this.flying[lost ? 'lost' : 'radio']++;
      const along = over > 0 && !lost ? 1 : lost ? Math.min(0.6, since / (0.5 * glow)) : since / Math.max(flights.delay[p], 1e-9);
      this.#arc(places.subarray(3 * from, 3 * from + 3), places.subarray(3 * to, 3 * to + 3), lost, fade, along, plain ? 1 : 24, scale);
    }
  }

  #arc(a, b, lost, fade, along, parts, scale) {
    const [dx, dy, dz] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    const far = Math.hypot(dx, dy, dz);
    const high = parts > 1 ? 0.13 * far : 0;
    const side = parts > 1 ? 0.07 : 0;
    const { ground } = this.theme;
    const base = lost ? this.theme.lost : this.theme.link;
    const colour = base.map((c, i) => ground[i] + (c - ground[i]) * (lost ? 0.4 + 0.6 * fade : 0.25 + 0.75 * fade));
    const at = (u) => {
      const bulge = 4 * u * (1 - u);
      return [a[0] + dx * u - dz * side * bulge, a[1] + dy * u + high * bulge, a[2] + dz * u + dx * side * bulge];
    };
    let p = at(0);
    for (let k = 1; k <= parts; k++) {
      const u = (k / parts) * Math.min(1, along);
      const q = at(u);
      this.links.add(...p, ...q, colour);
      p = q;
    }
    if (lost) {
      const s = Math.max(0.4, 0.012 * scale);
      this.links.add(p[0] - s, p[1] - s, p[2], p[0] + s, p[1] + s, p[2], this.theme.lost);
      this.links.add(p[0] - s, p[1] + s, p[2], p[0] + s, p[1] - s, p[2], this.theme.lost);
    } else if (along < 1 && parts > 1) {
      this.links.add(...at(Math.max(0, along - 0.06)), ...p, this.theme.pulse);
    }
  }
}
