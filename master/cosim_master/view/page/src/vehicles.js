// The vehicles at a time: instanced meshes by airframe, their shadows, and where they are for everybody else.
import { CircleGeometry, Color, DoubleSide, Group, InstancedMesh, Matrix4, MeshBasicMaterial, MeshLambertMaterial, Quaternion, Vector3 } from 'three';
import { airframe } from './airframes.js';
import { before } from './data.js';
import * as frames from './frames.js';

const MANY = 60; // with more vehicles than this, meshes are coarse

export class Vehicles {
  constructor(run) {
    this.run = run;
    this.group = new Group();
    this.n = run.vehicles.length;
    this.trueSize = false;
    this.places = new Float32Array(this.n * 3); // scene
    this.scales = new Float32Array(this.n).fill(1);
    this.classes = this.#classes();
    this.shadows = new InstancedMesh(
      new CircleGeometry(1, this.n > MANY ? 8 : 24).applyMatrix4(new Matrix4().makeRotationX(-Math.PI / 2)),
      new MeshBasicMaterial({ color: 0, transparent: true, opacity: 0.4, depthWrite: false }),
      Math.max(1, this.n),
    );
    this.shadows.count = this.n;
    this.shadows.frustumCulled = false;
    this.shadows.renderOrder = -1;
    this.group.add(this.shadows);
  }

  #classes() {
    const found = new Map();
    this.run.vehicles.forEach(({ rotors }, i) => {
      const key = JSON.stringify(rotors ?? null);
      if (!found.has(key)) found.set(key, { rotors, members: [] });
      found.get(key).members.push(i);
    });
    const coarse = this.n > MANY;
    return [...found.values()].map(({ rotors, members }) => {
      const frame = airframe(rotors, coarse, this.n > 300);
      const mesh = (geometry, material, count) => {
        const made = new InstancedMesh(geometry, material, count);
        made.frustumCulled = false;
        this.group.add(made);
        return made;
      };
      const count = members.length;
      const body = mesh(frame.body, new MeshLambertMaterial({ vertexColors: true }), count);
      const rotorCount = count * frame.hubs.length;
      const blades = rotorCount && !coarse ? mesh(frame.blades, new MeshLambertMaterial(), rotorCount) : null;
      const discs = rotorCount ? mesh(frame.disc, new MeshBasicMaterial({ transparent: true, opacity: 0.3, side: DoubleSide, depthWrite: false }), rotorCount) : null;
      return { ...frame, members, body, bladesMesh: blades, discs };
    });
  }

  paint(colours, theme) {
    for (const { members, body, bladesMesh, discs, hubs } of this.classes) {
      members.forEach((i, k) => {
        body.setColorAt(k, new Color(colours[i]));
        if (discs) for (let h = 0; h < hubs.length; h++) discs.setColorAt(k * hubs.length + h, new Color(colours[i]));
      });
      body.instanceColor.needsUpdate = true;
      if (discs) discs.instanceColor.needsUpdate = true;
      if (bladesMesh) bladesMesh.material.color.set(theme.blade);
    }
    this.shadows.material.opacity = theme.shadow;
  }

  /** Frames around a time, and how far it is from the first to the second of them. */
  at(t) {
    const { time } = this.run.motion;
    const i = before(time, t);
    const j = Math.min(i + 1, time.length - 1);
    const u = j > i ? Math.min(1, Math.max(0, (t - time[i]) / (time[j] - time[i]))) : 0;
    return [i, j, u];
  }

  /** A place of three columns (x, y, z of an array of all frames of the first, then the second, ...) at a time, NED. */
  static between(values, count, [i, j, u], out) {
    for (let k = 0; k < 3; k++) {
      const a = values[k * count + i];
      out[k] = u === 0 ? a : a + (values[k * count + j] - a) * u;
    }
    return out;
  }

  /** Move everything to where it is at a time, as large as it must be to be seen by a camera. */
  update(t, camera, pixels) {
    const at = this.at(t);
    const count = this.run.motion.stride;
    const ned = [0, 0, 0];
    const smallest = this.trueSize ? 0 : this.n <= 12 ? 68 : this.n <= MANY ? 30 : this.n <= 300 ? 17 : 12;
    const eye = camera.position;
    const metres = camera.isOrthographicCamera ? (camera.top - camera.bottom) / camera.zoom / pixels : (2 * Math.tan((camera.fov * Math.PI) / 360)) / pixels;
    const [matrix, turned, place, scale, q, q2, spin] = [new Matrix4(), new Matrix4(), new Vector3(), new Vector3(), new Quaternion(), new Quaternion(), new Quaternion()];
    const up = new Vector3(0, 1, 0);
    for (const { members, body, bladesMesh, discs, hubs, reach } of this.classes) {
      members.forEach((i, k) => {
        const vehicle = this.run.vehicles[i];
        Vehicles.between(vehicle.position, count, at, ned);
        place.set(frames.x(ned), frames.y(ned), frames.z(ned));
        place.toArray(this.places, 3 * i);
        const far = camera.isOrthographicCamera ? 1 : place.distanceTo(eye);
        const s = Math.max(1, (smallest * metres * far) / (2 * reach));
        this.scales[i] = s * reach;
        attitude(vehicle.attitude, count, at, q, q2);
        matrix.compose(place, q, scale.setScalar(s));
        body.setMatrixAt(k, matrix);
        if (discs) {
          const speed = vehicle.speed ? vehicle.speed[at[0]] / 255 : 0.5;
          hubs.forEach((hub, h) => {
            const n = k * hubs.length + h;
            turned.makeTranslation(hub.place).premultiply(matrix);
            discs.setMatrixAt(n, turned);
            if (!bladesMesh) return;
            // Not its speed, at which pictures would show it standing: a turn that the eye can follow.
            spin.setFromAxisAngle(up, (speed > 0.02 ? hub.direction * (t * 23 + h) : h) % (2 * Math.PI));
            bladesMesh.setMatrixAt(n, turned.multiply(new Matrix4().makeRotationFromQuaternion(spin)));
          });
        }
        const height = Math.max(0, place.y);
        const blob = this.scales[i] * 0.6 * (1 + Math.min(2, height / 60));
        this.shadows.setMatrixAt(i, matrix.makeScale(blob, 1, blob).setPosition(place.x, 0.01, place.z));
      });
      body.instanceMatrix.needsUpdate = true;
      if (discs) discs.instanceMatrix.needsUpdate = true;
      if (bladesMesh) bladesMesh.instanceMatrix.needsUpdate = true;
    }
    this.shadows.instanceMatrix.needsUpdate = true;
  }

  place(i, out = new Vector3()) {
    return out.fromArray(this.places, 3 * i);
  }
}

/** The attitude at a time for the scene: between two frames on the straight line, which is short. */
function attitude(values, count, [i, j, u], out, other) {
  if (!values) return out.identity();
  const read = (f, into) => frames.rotation(values[f], values[count + f], values[2 * count + f], values[3 * count + f], into);
  read(i, out);
  if (u > 0) {
    read(j, other);
    const same = out.dot(other) < 0 ? -1 : 1;
    out.set(out.x + (same * other.x - out.x) * u, out.y + (same * other.y - out.y) * u, out.z + (same * other.z - out.z) * u, out.w + (same * other.w - out.w) * u);
  }
  return out.normalize();
}
