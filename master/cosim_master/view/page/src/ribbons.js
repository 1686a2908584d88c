// Lines of a width in pixels whose ends have a time and a colour: trails, links, drop lines.
//
// A segment is a quad that the vertex shader widens on the screen. Each end has a time: what lies after `now` is not
// drawn, and what lies before fades over `fade`. So a trail needs no work while time goes on.
import { BufferAttribute, BufferGeometry, Mesh, ShaderMaterial, Vector2, DynamicDrawUsage } from 'three';

const VERTEX = `
attribute vec3 other; attribute vec3 colour; attribute vec2 corner; attribute float when;
uniform vec2 size; uniform float width; varying vec3 vColour; varying float vWhen;
void main() {
  vec4 a = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  vec4 b = projectionMatrix * modelViewMatrix * vec4(other, 1.0);
  float near = 0.01;
  if (a.w < near && b.w > near) a = mix(b, a, (b.w - near) / (b.w - a.w));
  if (b.w < near && a.w > near) b = mix(a, b, (a.w - near) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) * size;
  float length2 = max(dot(along, along), 1e-9);
  vec2 normal = vec2(-along.y, along.x) * inversesqrt(length2) * corner.x * corner.y;
  a.xy += normal * width / size * a.w;
  gl_Position = a; vColour = colour; vWhen = when;
}`;
const FRAGMENT = `
uniform float now; uniform float fade; uniform float opacity; varying vec3 vColour; varying float vWhen;
void main() {
  if (vWhen > now) discard;
  float alpha = fade > 0.0 ? 1.0 - (now - vWhen) / fade : 1.0;
  if (alpha <= 0.0) discard;
  gl_FragColor = vec4(vColour, opacity * alpha);
  #include <colorspace_fragment>
}`;

const WRITTEN = ['position', 'other', 'colour', 'when'];

export class Ribbons {
  /** Room for so many segments; `dynamic` ones are written anew for every picture. */
  constructor(capacity, { width = 2, opacity = 1, dynamic = false } = {}) {
    const geometry = new BufferGeometry();
    const add = (name, size, Type = Float32Array) => {
      const attribute = new BufferAttribute(new Type(capacity * 4 * size), size);
      if (dynamic) attribute.setUsage(DynamicDrawUsage);
      geometry.setAttribute(name, attribute);
      return attribute.array;
    };
    this.position = add('position', 3);
    this.other = add('other', 3);
    this.colour = add('colour', 3);
    this.when = add('when', 1);
    const corner = add('corner', 2);
    const index = new Uint32Array(capacity * 6);
    for (let i = 0; i < capacity; i++) {
      corner.set([1, 1, -1, 1, 1, -1, -1, -1], i * 8); // x: which side, y: which way `along` points at this end
      index.set([0, 1, 2, 2, 1, 3].map((k) => 4 * i + k), i * 6);
    }
    geometry.setIndex(new BufferAttribute(index, 1));
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { size: { value: new Vector2(1, 1) }, width: { value: width }, now: { value: Infinity }, fade: { value: 0 }, opacity: { value: opacity } },
      transparent: true,
      depthWrite: false,
      side: 2,
    });
    this.mesh = new Mesh(geometry, this.material);
    this.mesh.frustumCulled = false;
    this.capacity = capacity;
    this.used = 0;
  }

  clear() {
    this.used = 0;
  }

  /** A segment from a to b (x, y, z) with a colour (r, g, b) and the times at its ends. */
  add(ax, ay, az, bx, by, bz, colour, when0 = 0, when1 = when0) {
    if (this.used >= this.capacity) return;
    const i = this.used++;
    const { position, other, when } = this;
    for (let k = 0; k < 4; k++) {
      const at = (4 * i + k) * 3;
      const first = k < 2;
      position[at] = first ? ax : bx;
      position[at + 1] = first ? ay : by;
      position[at + 2] = first ? az : bz;
      other[at] = first ? bx : ax;
      other[at + 1] = first ? by : ay;
      other[at + 2] = first ? bz : az;
      this.colour[at] = colour[0];
      this.colour[at + 1] = colour[1];
      this.colour[at + 2] = colour[2];
      when[4 * i + k] = first ? when0 : when1;
    }
  }

  /** Draw segments from `first` to `last`, written since the last picture if `written`. */
  show(first, last, written) {
    this.mesh.geometry.setDrawRange(first * 6, Math.max(0, last - first) * 6);
    this.mesh.visible = last > first;
    if (!written || last <= first) return;
    for (const name of WRITTEN) this.mesh.geometry.attributes[name].clearUpdateRanges();
    this.upload(0, last);
  }

  /** Let the next picture take over segments from `first` to `last`. */
  upload(first, last) {
    if (last <= first) return;
    for (const name of WRITTEN) {
      const attribute = this.mesh.geometry.attributes[name];
      attribute.addUpdateRange(first * 4 * attribute.itemSize, (last - first) * 4 * attribute.itemSize);
      attribute.needsUpdate = true;
    }
  }
}
