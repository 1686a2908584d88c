// Ground with a grid whose lines keep apart at any distance, its axes, and the sky.
import { BackSide, Color, DoubleSide, Group, Mesh, PlaneGeometry, ShaderMaterial, SphereGeometry, Vector2 } from 'three';

const FRAGMENT = `
uniform vec3 ground, grid, major, east, north, horizon; uniform vec2 centre; uniform float step_, reach; varying vec2 at;
float line(vec2 p, float step_, float width) {
  vec2 d = fwidth(p / step_); vec2 g = abs(fract(p / step_ - 0.5) - 0.5) / max(d, 1e-6);
  return (1.0 - min(min(g.x, g.y) / width, 1.0)) * (1.0 - smoothstep(0.25, 0.6, max(d.x, d.y)));
}
void main() {
  float far = length(at - centre) / reach;
  vec3 c = mix(ground, grid, 0.55 * line(at, step_, 1.2));
  c = mix(c, major, 0.75 * line(at, step_ * 10.0, 1.5));
  vec2 w = fwidth(at) * 1.1;
  c = mix(c, east, (1.0 - smoothstep(w.y * 0.5, w.y, abs(at.y))) * 0.8);
  c = mix(c, north, (1.0 - smoothstep(w.x * 0.5, w.x, abs(at.x))) * 0.8);
  gl_FragColor = vec4(mix(c, horizon, smoothstep(0.25, 1.0, far)), 1.0);
  #include <colorspace_fragment>
}`;

export class Ground {
  constructor() {
    this.group = new Group();
    const colours = ['ground', 'grid', 'major', 'east', 'north', 'horizon'];
    this.plane = new Mesh(
      new PlaneGeometry(2, 2),
      new ShaderMaterial({
        vertexShader: 'varying vec2 at; void main() { vec4 w = modelMatrix * vec4(position, 1.0); at = w.xz; gl_Position = projectionMatrix * viewMatrix * w; }',
        fragmentShader: FRAGMENT,
        uniforms: { ...Object.fromEntries(colours.map((name) => [name, { value: new Color() }])), centre: { value: new Vector2() }, step_: { value: 1 }, reach: { value: 100 } },
        side: DoubleSide,
      }),
    );
    this.plane.rotation.x = -Math.PI / 2;
    this.plane.renderOrder = -3;
    this.plane.frustumCulled = false;
    this.sky = new Mesh(
      new SphereGeometry(1, 24, 12),
      new ShaderMaterial({
        vertexShader: 'varying float h; void main() { h = normalize(position).y; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
        fragmentShader: 'uniform vec3 sky, horizon; varying float h; void main() { gl_FragColor = vec4(mix(horizon, sky, smoothstep(0.0, 0.5, h)), 1.0);\n#include <colorspace_fragment>\n}',
        uniforms: { sky: { value: new Color() }, horizon: { value: new Color() } },
        side: BackSide,
        depthWrite: false,
      }),
    );
    this.sky.renderOrder = -4;
    this.sky.frustumCulled = false;
    this.group.add(this.sky, this.plane);
  }

  paint(theme) {
    for (const mesh of [this.plane, this.sky])
      for (const [name, uniform] of Object.entries(mesh.material.uniforms)) if (uniform.value.isColor) uniform.value.set(theme[name]);
  }

  /** The step of the grid is a power of ten that suits the distance; everything is centred below the camera's target. */
  update(camera, target, distance) {
    const step = 10 ** Math.floor(Math.log10(Math.max(distance, 1e-3) / 3));
    const reach = distance * 14 + 60;
    this.plane.position.set(target.x, 0, target.z);
    this.plane.scale.setScalar(reach);
    this.sky.position.copy(camera.position);
    this.sky.scale.setScalar(camera.far * 0.9);
    this.sky.visible = !camera.isOrthographicCamera;
    const { uniforms } = this.plane.material;
    uniforms.step_.value = step;
    uniforms.reach.value = reach;
    uniforms.centre.value.set(target.x, target.z);
    this.step = step;
  }
}
