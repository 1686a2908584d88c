// Names of vehicles and distances on the grid, drawn on a canvas above the scene; labels that would collide are left out.
import { Vector3 } from 'three';
import { $ } from './dom.js';

export class Labels {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
  }

  resize(width, height, ratio) {
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    Object.assign(this, { width, height, ratio });
  }

  /** Where a point of the scene is on the screen, px; null behind the camera. */
  project(point, camera) {
    const v = point.clone().applyMatrix4(camera.matrixWorldInverse);
    if (!camera.isOrthographicCamera && v.z > -0.05) return null;
    v.applyMatrix4(camera.projectionMatrix);
    return [((v.x + 1) / 2) * this.width, ((1 - v.y) / 2) * this.height];
  }

  update({ camera, target, vehicles, names, colours, theme, show, selected, hovered, ground, distance }) {
    const { context: c, ratio } = this;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    this.taken = [[0, 0, 150, 46 + ($('legend')?.clientHeight ?? 0)]]; // where the legend is
    c.lineJoin = 'round';
    if (show.labels) this.#names(c, { camera, vehicles, names, colours, theme, selected, hovered });
    if (show.grid) this.#axes(c, { camera, target, theme, ground, distance });
  }

  #text(c, text, x, y, { font, fill, halo, align = 'center', force = false }) {
    c.font = font;
    c.textAlign = align;
    c.textBaseline = 'middle';
    const width = c.measureText(text).width;
    const left = align === 'center' ? x - width / 2 : align === 'right' ? x - width : x;
    const box = [left - 3, y - 9, left + width + 3, y + 9];
    if (x < -20 || y < -20 || x > this.width + 20 || y > this.height + 20) return false;
    if (!force && this.taken.some((b) => box[0] < b[2] && b[0] < box[2] && box[1] < b[3] && b[1] < box[3])) return false;
    this.taken.push(box);
    c.lineWidth = 3.5;
    c.strokeStyle = halo;
    c.strokeText(text, x, y);
    c.fillStyle = fill;
    c.fillText(text, x, y);
    return true;
  }

  #names(c, { camera, vehicles, names, colours, theme, selected, hovered }) {
    const n = vehicles.n;
    const order = n <= 60 ? [...Array(n).keys()] : [];
    const shown = [...new Set([selected, hovered, ...order].filter((i) => i >= 0))];
    const point = new Vector3();
    for (const i of shown) {
      const s = vehicles.scales[i];
      vehicles.place(i, point);
      const at = this.project(point, camera);
      if (!at) continue;
      const edge = this.project(point.add(new Vector3(0, 0, 0)).addScaledVector(new Vector3().setFromMatrixColumn(camera.matrixWorld, 1), s), camera);
      const up = edge ? Math.abs(edge[1] - at[1]) : 12;
      const strong = i === selected || i === hovered;
      if (strong) this.#ring(c, at, Math.max(12, up * 1.15), colours[i]);
      this.#text(c, names[i], at[0], at[1] - up - 11, { font: `600 ${strong ? 15 : 13.5}px system-ui, "DejaVu Sans", sans-serif`, fill: theme.label, halo: theme.halo, force: strong });
    }
  }

  #ring(c, [x, y], radius, colour) {
    c.beginPath();
    c.arc(x, y, radius, 0, 2 * Math.PI);
    c.lineWidth = 2;
    c.strokeStyle = colour;
    c.stroke();
  }

  #axes(c, { camera, target, theme, ground, distance }) {
    let step = ground.step;
    while (distance / step > 14) step *= distance / step > 35 ? 5 : 2;
    const options = { font: '11.5px system-ui, "DejaVu Sans", sans-serif', fill: theme.major, halo: theme.halo };
    const write = (x, z, text) => {
      const at = this.project(new Vector3(x, 0, z), camera);
      if (at) this.#text(c, text, at[0], at[1] + 10, options);
    };
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    const [east, north] = [Math.round(target.x / step), Math.round(-target.z / step)];
    for (let k = -12; k <= 12; k++) {
      const e = (east + k) * step;
      const n = (north + k) * step;
      write(e, 0, e === 0 ? '0' : `${e.toFixed(digits)} m E`);
      if (n !== 0) write(0, -n, `${n.toFixed(digits)} m N`);
    }
  }
}
