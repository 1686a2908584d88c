// Three ways to look: free, following a vehicle, and from above with north up.
import { OrthographicCamera, PerspectiveCamera, Vector3 } from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';

export const CAMERAS = ['free', 'follow', 'top'];

export class Cameras {
  constructor(canvas, changed) {
    this.perspective = new PerspectiveCamera(45, 1, 0.1, 1e5);
    this.orthographic = new OrthographicCamera(-1, 1, 1, -1, 0.1, 1e5);
    this.orthographic.up.set(0, 0, -1);
    this.kind = 'free';
    this.controls = new OrbitControls(this.perspective, canvas);
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.map = new OrbitControls(this.orthographic, canvas);
    this.map.enableRotate = false;
    this.map.screenSpacePanning = true;
    this.map.mouseButtons = { LEFT: 2, MIDDLE: 1, RIGHT: 2 };
    this.map.touches = { ONE: 1, TWO: 2 };
    for (const controls of [this.controls, this.map]) {
      controls.enableDamping = false;
      controls.addEventListener('change', changed);
    }
    this.map.enabled = false;
    this.followed = -1;
    this.last = new Vector3();
  }

  get camera() {
    return this.kind === 'top' ? this.orthographic : this.perspective;
  }

  get target() {
    return this.kind === 'top' ? this.map.target : this.controls.target;
  }

  get distance() {
    if (this.kind === 'top') return (this.orthographic.top - this.orthographic.bottom) / this.orthographic.zoom;
    return Math.max(0.5, this.perspective.position.distanceTo(this.controls.target));
  }

  resize(width, height) {
    this.aspect = width / height;
    this.perspective.aspect = this.aspect;
    this.perspective.updateProjectionMatrix();
    this.#frustum(this.half ?? 1);
  }

  #frustum(half) {
    this.half = half;
    Object.assign(this.orthographic, { left: -half * this.aspect, right: half * this.aspect, top: half, bottom: -half });
    this.orthographic.updateProjectionMatrix();
  }

  /** Put the free and the top camera where they see a box (min and max of the scene) at a comfortable slant. */
  fit(min, max) {
    const middle = new Vector3().addVectors(min, max).multiplyScalar(0.5);
    const [width, depth] = [max.x - min.x, max.z - min.z];
    const aspect = this.aspect || 1.6;
    this.#frustum(Math.max(0.62 * depth, (0.58 * width) / aspect, 6));
    this.map.target.set(middle.x, 0, middle.z);
    this.orthographic.position.set(middle.x, max.y + 500, middle.z);
    this.orthographic.zoom = 1;
    this.orthographic.updateProjectionMatrix();
    this.#aim(min, max, middle, Math.max(width, depth, max.y - min.y, 6));
    this.home = [this.perspective.position.clone(), this.controls.target.clone()];
    this.controls.update();
    this.map.update();
  }

  /** Look at a box from the south-west so that all of its corners are in the picture, and it in the middle of it. */
  #aim(min, max, middle, size) {
    const { perspective } = this;
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => new Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z));
    const deep = Math.min(1, (max.z - min.z) / Math.max(max.x - min.x, 1)); // a field is seen from higher up than a line
    const from = new Vector3(-0.14, 0.34 + 0.4 * deep, 0.9).normalize();
    const target = middle.clone();
    let away = size * 0.4;
    for (let step = 0; step < 60; step++) {
      perspective.position.copy(target).addScaledVector(from, away);
      perspective.lookAt(target);
      perspective.near = away / 100;
      perspective.far = away * 100 + size * 10;
      perspective.updateProjectionMatrix();
      perspective.updateMatrixWorld();
      const seen = corners.map((corner) => corner.clone().project(perspective));
      const behind = corners.some((corner) => corner.clone().applyMatrix4(perspective.matrixWorldInverse).z > -0.02 * away);
      const [left, right] = [Math.min(...seen.map((p) => p.x)), Math.max(...seen.map((p) => p.x))];
      const [low, high] = [Math.min(...seen.map((p) => p.y)), Math.max(...seen.map((p) => p.y))];
      if (!behind && Math.abs(left + right) / 2 < 0.5 && Math.abs(low + high) / 2 < 0.5) {
        const side = new Vector3().setFromMatrixColumn(perspective.matrixWorld, 0);
        const reach = away * Math.tan((perspective.fov * Math.PI) / 360);
        target.addScaledVector(side, ((left + right) / 2) * reach * this.aspect * 0.5);
        target.y += ((low + high) / 2 + 0.04) * reach * 0.5;
      }
      if (!behind && right - left < 1.66 && high - low < 1.4) {
        if (Math.abs(left + right) < 0.02) break;
      } else away *= 1.07;
    }
    this.controls.target.copy(target);
  }

  use(kind, followed, place) {
    const was = this.kind;
    this.kind = kind;
    this.controls.enabled = kind !== 'top';
    this.map.enabled = kind === 'top';
    this.followed = kind === 'follow' ? followed : -1;
    if (kind === 'follow' && place) {
      const offset = new Vector3().subVectors(this.perspective.position, this.controls.target);
      if (was !== 'follow' || offset.length() > 60) offset.set(-0.5, 0.42, 1).normalize().multiplyScalar(5.5);
      this.controls.target.copy(place);
      this.perspective.position.copy(place).add(offset);
      this.last.copy(place);
    } else if (kind === 'free' && was === 'follow' && this.home) {
      this.perspective.position.copy(this.home[0]);
      this.controls.target.copy(this.home[1]);
    }
    (kind === 'top' ? this.map : this.controls).update();
  }

  /** Go along with the vehicle that is followed. */
  follow(place) {
    if (this.followed < 0) return;
    const moved = place.clone().sub(this.last);
    if (moved.lengthSq() === 0) return;
    this.last.copy(place);
    this.controls.target.add(moved);
    this.perspective.position.add(moved);
    this.controls.update();
  }

  planes() {
    const far = this.distance * 20 + 2000;
    const { perspective } = this;
    perspective.near = Math.min(1, this.distance / 60);
    perspective.far = far;
    perspective.updateProjectionMatrix();
    this.perspective.updateMatrixWorld();
    this.orthographic.updateMatrixWorld();
  }
}
